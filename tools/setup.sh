#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Bring .venv and the built workspace up to date; do only what changed since the last time.
# With --dev also what the tests need.
set -euo pipefail
began=$SECONDS
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
cd "$root"

# Two set-ups at once (two terminals, parallel make) would tread on each other.
if command -v flock >/dev/null; then
  exec 9<"$root"
  flock 9
fi

# Prints a stamp of what stands on stdin; the folder is in it because venvs and builds do not move.
stamp() { { echo "$root"; cat; } | sha256sum | cut -d ' ' -f 1; }

# Runs a command that is silent while it works, and tells every ten seconds that it does.
with_time() {
  local what=$1 start=$SECONDS
  shift
  (while sleep 10; do echo "set-up:   $what, $((SECONDS - start)) s so far"; done) &
  local clock=$! code=0
  "$@" || code=$?
  kill "$clock" 2>/dev/null || true
  wait "$clock" 2>/dev/null || true
  return "$code"
}

# Says once, when there is much to do, how long that takes.
takes_time() {
  [ -z "${told:-}" ] || return 0
  told=yes
  echo 'set-up: two to four minutes the first time, most of it downloads and the generated messages'
}

up_to_date() { [ -f "$1" ] && [ "$(cat "$1")" = "$2" ]; }

make_venv() {
  if [ -x .venv/bin/python ] && .venv/bin/python -c '' 2>/dev/null && up_to_date .venv/place "$root"
  then
    [ -z "${PYTHON:-}" ] && return
    # An interpreter asked for by name must be the one that the venv stands on.
    local base='import sys; print(sys.version_info[:2])'
    [ "$("$PYTHON" -c "$base")" = "$(.venv/bin/python -c "$base")" ] && return
  fi
  local python
  python=$(tools/preflight.sh)
  takes_time
  echo "set-up: .venv with $("$python" --version)"
  # What was built belongs to the interpreter and the folder it was built with.
  rm -rf .venv ros2_ws/build ros2_ws/install
  "$python" -m venv .venv
  echo "$root" >.venv/place
}

# The list is complete, so nothing is left to resolve; modules compile when first imported. empy
# alone has no wheel. (In a list pip would read these options the other way round.)
by_pip() {
  .venv/bin/python -m pip install --quiet --disable-pip-version-check --no-deps --no-compile \
    --use-pep517 --only-binary :all: --no-binary empy -r "$1"
}

# uv loads side by side what pip loads one after the other: several times as fast. It is told what
# pip is configured to; where it fails all the same, pip has the last word.
by_uv() {
  local settings
  if [ ! -x .venv/bin/uv ]; then
    sed -n '/^uv==/,/[^\\]$/p' requirements-dev.txt >.venv/uv.txt
    by_pip .venv/uv.txt || return
  fi
  mapfile -t settings < <(.venv/bin/python -m pip config list | .venv/bin/python tools/uv_settings.py)
  env "${settings[@]}" .venv/bin/uv pip install --quiet --python .venv/bin/python --no-deps \
    --require-hashes --only-binary :all: --no-binary empy -r "$1"
}

fetch_wheels() {
  by_uv "$1" && return
  echo "set-up: uv could not do it, now by pip" >&2
  by_pip "$1"
}

install_wheels() {
  local list=$1 want
  want=$(stamp <"$list")
  up_to_date ".venv/$list" "$want" && return
  takes_time
  echo "set-up: $(grep -c '^[a-z].*==' "$list") wheels of $list"
  with_time "wheels of $list" fetch_wheels "$list"
  # Where Python may write none by itself, every process would compile what it imports anew.
  if [ -n "${PYTHONDONTWRITEBYTECODE:-}" ]; then
    .venv/bin/python -m compileall -qq -j 0 -x '/(tests?|testing|pip|setuptools)/' \
      .venv/lib/python*/site-packages || true # templates that are no modules
  fi
  echo "$want" >".venv/$list"
}

# What a build of the package in folder $1 depends on. Python modules and the contents of data
# files are linked, not copied: of those only the names count.
sources() {
  sha256sum .venv/requirements.txt
  find "$1" -type f ! -name '*.py' ! -name '*.pyc' ! -name '*.so' ! -path '*/test/*' \
    ! -path '*.egg-info/*' | sort
  find "$1" -type f \( -path '*/calib_interfaces/*' -o -name '*.c' -o -name '*.h' \
    -o -name setup.py -o -name setup.cfg -o -name package.xml \) -print0 | sort -z |
    xargs -0 sha256sum
}

build_workspace() {
  local folder package changed=()
  for folder in ros2_ws/src/*/; do
    package=$(basename "$folder")
    up_to_date "ros2_ws/install/$package/.built" "$(sources "$folder" | stamp)" ||
      changed+=("$package")
  done
  [ -n "${PYTHONDONTWRITEBYTECODE:-}" ] && .venv/bin/python -m compileall -qq -j 0 ros2_ws/src
  [ ${#changed[@]} = 0 ] && return
  takes_time
  echo "set-up: build of ${changed[*]}"
  PATH="$root/.venv/bin:$PATH" AMENT_PREFIX_PATH="$root/.venv" CMAKE_PREFIX_PATH="$root/.venv" \
    build_packages "${changed[@]}"
  for package in "${changed[@]}"; do
    sources "ros2_ws/src/$package/" | stamp >"ros2_ws/install/$package/.built"
  done
}

build_packages() {
  local log=ros2_ws/log/set-up.txt
  mkdir -p ros2_ws/log
  # The venv is no colcon workspace, which colcon remarks on; what it says is shown if it fails.
  # Left to itself colcon lets make wait for a quiet machine.
  if ! (cd ros2_ws && MAKEFLAGS=${MAKEFLAGS:--j$(nproc)} with_time build colcon build \
    --symlink-install --packages-select "$@") 2>&1 | tee "$log" |
    sed -u '/^Finished <<< /!{/^set-up: /!d}; s/^Finished <<< /set-up:   built /'; then
    cat "$log" >&2
    echo "set-up: the build failed, see above (also in $log)" >&2
    exit 1
  fi
  grep -A3 'warning: build_ext' "$log" || true
}

# A sourced ROS installation or another venv must not leak into this one.
unset PYTHONPATH PYTHONHOME AMENT_PREFIX_PATH CMAKE_PREFIX_PATH COLCON_PREFIX_PATH LD_LIBRARY_PATH \
  _ROS_WHEELS_BOOTSTRAP_COMPLETE
make_venv
install_wheels requirements.txt
[ "${1:-}" = --dev ] && install_wheels requirements-dev.txt
build_workspace
[ -z "${told:-}" ] || echo "set-up: done in $((SECONDS - began)) s"
