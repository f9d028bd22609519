#!/usr/bin/env bash
# Runs the C++ tests, then the Python tests; extra arguments go to pytest.
# pytest runs last, so that its summary closes the output.
#
#   SIM2VR_TEST_WORKERS=1   pytest processes (default: one per core, at most 4)
#   SIM2VR_TEST_DOWNLOADS=1   play OpenXR programs (204 MB into build/openxr) and the example pages'
#                             engines (npm, 180 MB), too; both are loaded once
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
# What others made is no part of the package: its tests are skipped where loading fails.
programs=$PWD/build/openxr
if [[ -n ${SIM2VR_TEST_DOWNLOADS:-} ]]; then
  timeout 120 sh docs/examples/webxr/engines.sh >build/log/engines.log 2>&1 ||
    echo "engines of example pages: not installed (build/log/engines.log); their tests are skipped"
  if ! cmp -s tests/openxr_programs.txt "$programs/installed.txt"; then
    echo "OpenXR programs: installing tests/openxr_programs.txt (204 MB)"
    if .venv/bin/python -m venv "$programs" && timeout 300 "$programs/bin/python" -m pip \
      --disable-pip-version-check --no-input install -q -r tests/openxr_programs.txt \
      >build/log/openxr-programs.log 2>&1; then
      cp tests/openxr_programs.txt "$programs/installed.txt"
    else
      echo "OpenXR programs: not installed (build/log/openxr-programs.log); their tests are skipped"
    fi
  fi
  export SIM2VR_OPENXR_PYTHON=$programs/bin/python
fi

echo "Python tests:"
.venv/bin/python -m pytest "$@" || { code=$?; ((status)) || status=$code; }
exit "$status"
