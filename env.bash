# SPDX-License-Identifier: Apache-2.0
# Source me: the venv, the built workspace and, where the machine has no ros2, the stand-in.

_calib_root=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)

if [ ! -x "$_calib_root/.venv/bin/python" ] ||
  [ ! -f "$_calib_root/ros2_ws/install/local_setup.bash" ]; then
  echo "env.bash: nothing is built yet, run 'make' in $_calib_root first" >&2
  unset _calib_root
  return 1
fi

# Prepends folder $2 to the list in variable $1, once.
_calib_prepend() {
  case ":${!1:-}:" in
    *":$2:"*) ;;
    *) export "$1=$2${!1:+:${!1}}" ;;
  esac
}

export VIRTUAL_ENV=$_calib_root/.venv
_calib_prepend PATH "$VIRTUAL_ENV/bin"
_calib_prepend AMENT_PREFIX_PATH "$VIRTUAL_ENV"

# The wheels' own start-up sets library paths once per process tree: a tree started from another
# venv would keep that one's libraries.
unset _ROS_WHEELS_BOOTSTRAP_COMPLETE

# colcon's scripts read variables that may be unset and run commands that may fail.
_calib_flags=$-
set +eu
source "$_calib_root/ros2_ws/install/local_setup.bash"
case $_calib_flags in *u*) set -u ;; esac
case $_calib_flags in *e*) set -e ;; esac

# Where a real ros2 is on the path it is the one to use.
command -v ros2 >/dev/null || _calib_prepend PATH "$_calib_root/tools/ros2"

export RMW_IMPLEMENTATION=${RMW_IMPLEMENTATION:-rmw_fastrtps_cpp}
# How fast processes find one another; a file of the user's own comes first.
if [ -z "${FASTDDS_DEFAULT_PROFILES_FILE:-}" ]; then
  export FASTRTPS_DEFAULT_PROFILES_FILE=${FASTRTPS_DEFAULT_PROFILES_FILE:-$_calib_root/tools/fastdds.xml}
fi
export ROS_AUTOMATIC_DISCOVERY_RANGE=${ROS_AUTOMATIC_DISCOVERY_RANGE:-LOCALHOST}

unset -f _calib_prepend
unset _calib_root _calib_flags
