#!/usr/bin/env bash
# The checks that take too long for every commit. Arguments name parts; without any, all run:
#   asan-ubsan, tsan   the C++ tests with sanitizers (gcc)
#   fuzz               every libFuzzer program for SIM2VR_FUZZ_SECONDS (60), if clang++ is there
#   attacks            damaged files, hostile messages; killed trainings, apps and browsers (tools/attack)
#   slow               tests that train
#   engines            a page with many versions of three.js and A-Frame, from npm
#   guides             the commands of README, guides and tutorials
#   wheel              made, installed and used by another account (SIM2VR_ACCOUNT: nobody)
#   container          the image of the Dockerfile
#   python3.11 ... 13  set up and tested in a clone, with this Python
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
  .venv/bin/python tools/attack/kill_trainers.py --rounds 2 || status=1
  .venv/bin/python tools/attack/kill_cycles.py --cycles 10 || status=1
  .venv/bin/python tools/attack/server_messages.py --messages 5000 --signals 50 || status=1
  .venv/bin/python tools/attack/recorder.py --kills 10 || status=1
  sh docs/examples/webxr/engines.sh && .venv/bin/python tools/attack/kill_browsers.py --kills 10 || status=1
  .venv/bin/python tools/attack/kill_browsers.py --kills 10 --openxr "hello_xr -g OpenGL" || status=1
  return "$status"
}

slow() { SIM2VR_PARTS=python SIM2VR_REQUIRE=runtime,browser,openxr,npm tools/dev/check.sh -m slow; }

engines() { .venv/bin/python tools/research/engine_matrix.py; }

guides() { .venv/bin/python tools/docs/run_guides.py --limit 600; }

# As in the workflow that designers copy (docs/examples/ci_workflow.yml): pip installs a wheel and the checks
# pass, for an account that is not the checkout's owner.
wheel() {
  local folder as=() pip
  mapfile -t pip < <(env | grep ^PIP_)  # where packages come from
  ((EUID == 0)) && as=(runuser -u "${SIM2VR_ACCOUNT:-nobody}" --)
  PYTHON=.venv/bin/python tools/dev/wheel.sh || return 1
  folder=$(mktemp -d /tmp/sim2vr-wheel.XXXX)
  mkdir "$folder/ci"
  cp dist/sim2vr_harness-*manylinux*.whl "$folder/ci/"
  .venv/bin/python -c 'import yaml; print(yaml.safe_load(open("docs/examples/ci_workflow.yml"))["jobs"]["play"]["steps"][3]["run"])' \
    >"$folder/play.sh"
  cat >"$folder/all.sh" <<END
python3 -m venv venv
pip install --quiet --no-deps "torch==$(sed -n 's/^torch==//p' requirements.lock)+cpu" ||
  echo "no CPU build of torch within reach: pip takes the default one"
pip install --quiet ci/sim2vr_harness-*.whl
sim2vr-harness doctor
sim2vr-harness evaluate --user random --set env.app.game=sample --condition usual --condition big --episodes 3 --out first
cp first/results.json ci/baseline.json
source play.sh
sim2vr-harness evaluate pretrained:whacamole_people --condition easy --episodes 1 --record --out film
END
  if ((EUID == 0)); then chown -R "${SIM2VR_ACCOUNT:-nobody}" "$folder"; fi
  (cd "$folder" && "${as[@]}" env -i HOME="$folder" TMPDIR="$folder" PATH="$folder/venv/bin:/usr/bin:/bin" \
    "${pip[@]}" bash -euo pipefail all.sh) && rm -rf "$folder"
}

container() {
  mkdir -p build/container
  docker build -t sim2vr . && docker run --rm -v "$PWD/build/container:/out" sim2vr &&
    ls build/container/*.mp4
}

# Another Python has an extension module and packages of its own, so it gets a clone of its own.
another_python() {
  command -v "$1" >/dev/null && "$1" -c "" || { echo "$1 is not here"; return 1; }
  rm -rf "build/$1" && git clone --quiet . "build/$1" &&
    (cd "build/$1" && SIM2VR_PYTHON=$1 make setup && SIM2VR_PARTS="cpp python" tools/dev/check.sh)
}

known="asan-ubsan tsan fuzz attacks slow engines guides wheel container python3.11 python3.12 python3.13"
parts=("$@")
((${#parts[@]})) || read -ra parts <<<"$known"
failed=()
for part in "${parts[@]}"; do
  echo "== $part"
  case $part in
    asan-ubsan | tsan) sanitizer "$part" || failed+=("$part") ;;
    python3.1[123]) another_python "$part" || failed+=("$part") ;;
    fuzz | attacks | slow | engines | guides | wheel | container) "$part" || failed+=("$part") ;;
    *)
      echo "part: got $part, expected one of: $known" >&2
      exit 2
      ;;
  esac
done
if ((${#failed[@]})); then
  echo "failed: ${failed[*]}"
  exit 1
fi
echo "nothing was found"
