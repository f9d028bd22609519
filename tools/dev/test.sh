#!/usr/bin/env bash
# Runs the C++ tests, then the Python tests; extra arguments go to pytest.
# pytest runs last, so that its summary closes the output.
#
#   SIM2VR_TEST_WORKERS=1   pytest processes (default: one per core, at most 4)
set -euo pipefail
cd "$(dirname "$0")/../.."
jobs=${SIM2VR_JOBS:-$(nproc)}
workers=${SIM2VR_TEST_WORKERS:-$(($(nproc) < 4 ? $(nproc) : 4))}

echo "C++ tests: building"
cmake --build --preset release --parallel "$jobs" >build/log/build-tests.log 2>&1 || {
  tail -n 60 build/log/build-tests.log >&2
  echo "the C++ tests do not build; to see all of it: cmake --build --preset release" >&2
  exit 1
}
status=0
ctest --preset release --parallel "$jobs" || status=$?
if ((status)); then echo "C++ tests: FAILED (details above)"; else echo "C++ tests: passed"; fi

# One worker per core: keep the numerical libraries from starting threads of their own.
if ((workers > 1)); then
  export OMP_NUM_THREADS=${OMP_NUM_THREADS:-1}
  set -- -n "$workers" --dist loadfile "$@"
fi
echo "Python tests:"
.venv/bin/python -m pytest "$@" || { code=$?; ((status)) || status=$code; }
exit "$status"
