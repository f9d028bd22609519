#!/usr/bin/env bash
# The checks that take too long for every commit. Arguments name parts; without any, all run:
#   asan-ubsan, tsan   the C++ tests with sanitizers (gcc)
#   fuzz               every libFuzzer program for SIM2VR_FUZZ_SECONDS (60), if clang++ is there
#   attacks            damaged files, hostile messages and killed trainings (tools/attack)
# Runs all parts, names those that failed, and ends with status 1 if there is one.
set -uo pipefail
cd "$(dirname "$0")/../.."
jobs=${SIM2VR_JOBS:-$(nproc)}
mkdir -p build/log

sanitizer() {
  cmake --preset "$1" && cmake --build --preset "$1" --parallel "$jobs" &&
    ctest --preset "$1" --parallel "$jobs"
}

fuzz() {
  if ! command -v clang++ >/dev/null; then
    echo "fuzz: got no clang++, expected one; install clang and libclang-rt-14-dev (or your version's)"
    return 1
  fi
  cmake --preset fuzz && cmake --build --preset fuzz --parallel "$jobs" || return 1
  local program name status=0
  for program in build/fuzz/tests/fuzz/fuzz_*; do
    [[ -x $program && -f $program ]] || continue
    name=${program##*/fuzz_}
    mkdir -p "build/corpus/$name"
    # Saved states may have many megabytes, messages and files of a corpus a few kilobytes.
    length=8192
    [[ $name == saved_* ]] && length=67108864
    "$program" -max_total_time="${SIM2VR_FUZZ_SECONDS:-60}" -max_len="$length" -print_final_stats=1 \
      "build/corpus/$name" "tests/fuzz/corpus/$name" 2>"build/log/fuzz-$name.log" || {
      tail -n 30 "build/log/fuzz-$name.log"
      status=1
    }
    echo "fuzz $name: $(grep -c . "build/log/fuzz-$name.log") lines in build/log/fuzz-$name.log"
  done
  return "$status"
}

attacks() {
  local status=0
  .venv/bin/python tools/attack/fuzz_files.py || status=1
  .venv/bin/python tools/attack/kill_trainers.py || status=1
  return "$status"
}

parts=("$@")
((${#parts[@]})) || parts=(asan-ubsan tsan fuzz attacks)
failed=()
for part in "${parts[@]}"; do
  echo "== $part"
  case $part in
    asan-ubsan | tsan) sanitizer "$part" || failed+=("$part") ;;
    fuzz) fuzz || failed+=(fuzz) ;;
    attacks) attacks || failed+=(attacks) ;;
    *)
      echo "part: got $part, expected asan-ubsan, tsan, fuzz or attacks" >&2
      exit 2
      ;;
  esac
done
if ((${#failed[@]})); then
  echo "failed: ${failed[*]}"
  exit 1
fi
echo "nothing was found"
