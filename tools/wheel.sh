#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Build the wheel for CPython 3.10 to 3.13, as far as they are at hand, and try each where nothing
# else is installed: `make wheel`. PYTHONS names other interpreters.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
uv=.venv/bin/uv bag=bags/demo/identification
scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT

# On the path, and those that pyenv keeps off it; each version once.
at_hand() {
  local version python
  for version in 3.10 3.11 3.12 3.13; do
    for python in $(type -aP "python$version") \
      "$(pyenv root 2>/dev/null || true)"/versions/"$version".*/bin/python; do
      if [ "$("$python" -c 'import sys; print("%d.%d" % sys.version_info[:2])' 2>/dev/null)" \
        = "$version" ]; then
        echo "$python"
        break
      fi
    done
  done
}

rm -rf dist
for python in ${PYTHONS:-$(at_hand)}; do
  name=$("$python" -c 'import sys; print("%d.%d" % sys.version_info[:2])')
  venv=$scratch/$name
  echo "wheel: CPython $name, into an empty venv"
  "$uv" build --quiet --wheel --python "$python" --out-dir dist .
  "$uv" venv --quiet --python "$python" "$venv"
  "$uv" pip install --quiet --python "$venv/bin/python" dist/*-cp"${name/./}"-*.whl
  # an environment in which nothing else can be found
  (cd "$scratch" && env -i PATH=/usr/bin:/bin HOME="$scratch" "$venv/bin/calib" identify \
    "$OLDPWD/$bag" --output "$scratch/out$name") | grep '^at a place never probed'
done
ls dist/*.whl
