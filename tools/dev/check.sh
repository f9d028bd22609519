#!/usr/bin/env bash
# The check of this project. `make check`, `make test`, .ci/run and the public workflow run it after `make setup`.
# All parts run, even if one fails, and the run ends with their results and seconds.
#
#   SIM2VR_PARTS="lint types"   some of: format lint types cpp python
#   SIM2VR_TEST_WORKERS=1       pytest processes (default: one per core, at most 4)
#   SIM2VR_REQUIRE=runtime,browser,openxr,npm
#       parts of tests/parts.py without which tests fail instead of being skipped; openxr loads programs to play
#       (204 MB into build/openxr), npm the engines of the example pages (180 MB), both once
# Arguments go to pytest. Seconds of each test are in build/log/tests_cpp.xml and tests_python.xml.
set -uo pipefail
cd "$(dirname "$0")/../.."
jobs=${SIM2VR_JOBS:-$(nproc)}
workers=${SIM2VR_TEST_WORKERS:-$(($(nproc) < 4 ? $(nproc) : 4))}
bin=$PWD/.venv/bin
mkdir -p build/log

format() {
  local cpp
  mapfile -t cpp < <(git ls-files '*.cpp' '*.hpp')
  "$bin/ruff" format --check . && "$bin/clang-format" --dry-run --Werror "${cpp[@]}"
}

lint() {
  local file status=0
  "$bin/ruff" check . || status=1
  while read -r file; do bash -n "$file" || status=1; done < <(git ls-files '*.sh' .ci/run)
  return "$status"
}

types() { "$bin/mypy"; }

cpp() {
  cmake --build --preset release --parallel "$jobs" >build/log/build-tests.log 2>&1 || {
    tail -n 60 build/log/build-tests.log
    echo "the C++ tests do not build; to see all of it: cmake --build --preset release"
    return 1
  }
  ctest --preset release --parallel "$jobs" --output-junit "$PWD/build/log/tests_cpp.xml"
}

# What others made is no part of the package. Tests that need it fail where it is required and could be loaded.
others() {
  local programs=$PWD/build/openxr
  if [[ ,${SIM2VR_REQUIRE:-}, == *,npm,* ]]; then
    timeout 240 sh docs/examples/webxr/engines.sh >build/log/engines.log 2>&1 ||
      if timeout 30 npm ping >>build/log/engines.log 2>&1; then
        echo "engines of example pages: not installed (build/log/engines.log)"
      else
        not_reached npm
      fi
  fi
  if [[ ,${SIM2VR_REQUIRE:-}, == *,openxr,* ]] && ! cmp -s tests/openxr_programs.txt "$programs/installed.txt"; then
    echo "OpenXR programs: installing tests/openxr_programs.txt (204 MB)"
    if "$bin/python" -m venv "$programs" && timeout 300 "$programs/bin/python" -m pip \
      --disable-pip-version-check --no-input install -q -r tests/openxr_programs.txt >build/log/openxr-programs.log 2>&1; then
      cp tests/openxr_programs.txt "$programs/installed.txt"
    elif timeout 60 "$bin/python" -m pip index versions pip >>build/log/openxr-programs.log 2>&1; then
      echo "OpenXR programs: not installed (build/log/openxr-programs.log)"
    else
      not_reached openxr
    fi
  fi
  if [[ -f $programs/installed.txt ]]; then export SIM2VR_OPENXR_PYTHON=${SIM2VR_OPENXR_PYTHON:-$programs/bin/python}; fi
}

# Without a network a part cannot be there: its tests are skipped, and the run says so to its end.
not_reached() {
  local rest=",$SIM2VR_REQUIRE,"
  rest=${rest/,$1,/,} rest=${rest#,}
  export SIM2VR_REQUIRE=${rest%,}
  results+=("not required: $1, whose registry cannot be reached")
}

python() {
  others
  # One worker per core: keep the numerical libraries from starting threads of their own.
  if ((workers > 1)); then
    export OMP_NUM_THREADS=${OMP_NUM_THREADS:-1}
    set -- -n "$workers" --dist worksteal "$@"
  fi
  "$bin/python" -m pytest --durations=30 --junit-xml=build/log/tests_python.xml "$@"
}

results=()
failed=0
for part in ${SIM2VR_PARTS:-format lint types cpp python}; do
  case $part in
    format | lint | types | cpp | python) ;;
    *)
      echo "SIM2VR_PARTS: got $part, expected format, lint, types, cpp or python" >&2
      exit 2
      ;;
  esac
  began=$SECONDS result=passed arguments=()
  [[ $part == python ]] && arguments=("$@")
  echo "== $part"
  "$part" "${arguments[@]}" || { result=FAILED; failed=1; }
  results+=("$(printf '%-8s %-7s %5d s' "$part" "$result" $((SECONDS - began)))")
done
echo
printf '%s\n' "${results[@]}"
exit "$failed"
