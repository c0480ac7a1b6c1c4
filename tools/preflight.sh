#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Check what set-up needs before anything is downloaded. One line on stderr for each thing that is
# missing; where nothing is, the suited Python interpreter's path on stdout.
set -u

missing=0
lacks() { echo "preflight: $1" >&2; missing=1; }

check_platform() {
  local system machine libc
  system=$(uname -s) machine=$(uname -m)
  if [ "$system" != Linux ] || [ "$machine" != x86_64 ]; then
    lacks "the ROS 2 wheels exist for Linux x86_64 only, this is $system $machine"
    return
  fi
  libc=$(getconf GNU_LIBC_VERSION 2>/dev/null) || libc='no glibc'
  case $libc in
    'glibc 2.'*) [ "${libc#glibc 2.}" -ge 28 ] 2>/dev/null && return ;;
  esac
  lacks "the ROS 2 wheels need glibc 2.28 or newer, this system has ${libc}"
}

# What the interpreter $1 is, as 'cpython 3.11', or nothing where it does not run: version
# switchers leave commands on the path that only print an error.
identity() {
  "$1" -c 'import sys; print(sys.implementation.name, "%d.%d" % sys.version_info[:2])' 2>/dev/null
}

suited() {
  case $(identity "$1") in
    'cpython 3.10' | 'cpython 3.11' | 'cpython 3.12' | 'cpython 3.13') return 0 ;;
  esac
  return 1
}

makes_venvs() { "$1" -c 'import venv, ensurepip' 2>/dev/null; }

headers() { "$1" -c 'import sysconfig; print(sysconfig.get_path("include"))'; }

# The first interpreter that is suited and complete, else the first that is suited, so that what
# it lacks can be said.
find_python() {
  local name path seen=''
  for name in ${PYTHON:-python3 python3.13 python3.12 python3.11 python3.10}; do
    while read -r path; do
      if suited "$path"; then
        python=${python:-$path}
        makes_venvs "$path" && [ -f "$(headers "$path")/Python.h" ] && python=$path && return
      fi
      seen="$seen${seen:+, }$path is $(identity "$path" || echo 'not running')"
    done < <(type -aP "$name")
  done
  [ -n "$python" ] ||
    lacks "CPython 3.10 to 3.13 is needed, name one with PYTHON=... (${seen:-no python3 is there})"
}

check_python() {
  makes_venvs "$python" ||
    lacks "$python cannot make virtual environments (Debian, Ubuntu: apt-get install python3-venv)"
}

check_build_tools() {
  local compiler='' name include
  for name in ${CXX:-c++ g++ clang++}; do
    command -v "$name" >/dev/null && compiler=$name && break
  done
  command -v make >/dev/null || lacks 'no make (Debian, Ubuntu: apt-get install make)'
  if [ -z "$compiler" ]; then
    lacks 'no C++ compiler (Debian, Ubuntu: apt-get install g++)'
  elif ! echo '#include <vector>' | "$compiler" -x c++ -fsyntax-only - 2>/dev/null; then
    lacks "the C++ compiler '$compiler' cannot compile an empty program"
  elif [ -n "$python" ]; then
    include=$(headers "$python")
    echo '#include <Python.h>' | "$compiler" -x c++ -fsyntax-only -I "$include" - 2>/dev/null ||
      lacks "no Python.h in $include (Debian, Ubuntu: apt-get install python3-dev)"
  fi
}

python=''
check_platform
find_python
[ -n "$python" ] && check_python
check_build_tools
[ "$missing" = 0 ] && echo "$python"
exit "$missing"
