#!/usr/bin/env bash
# Measure what a GPU and many cores give, in at most eight minutes on 16 cores with an H100.
#
#   tools/bench/gpu.sh [FOLDER] [SECONDS]
#
# 1. tests that need a GPU; 2. users per second on 1 to all cores, with physics alone beside them;
# 3. apps that play while bodies move, in several parts; 4. a recipe from nothing to its evaluation.
# What is found goes to FOLDER (default build/bench/gpu); summary.txt has it in short. SECONDS: of
# all together (default 480); what does not fit is stopped. PYTHON: an interpreter that has
# sim2vr-harness (default .venv/bin/python). CONFIG: the recipe. PARTS: which of the parts, such as
# "tests suite": suite, all tests of trainings and policies, is not among the default ones. RUN: where
# the recipe's run goes (default build/bench/gpu_run). Needs no network.
set -uo pipefail
cd "$(dirname "$0")/../.."
folder=${1:-build/bench/gpu}
ends=$(($(date +%s) + ${2:-480}))
config=${CONFIG:-configs/whacamole_constrained_distill.yaml}
export PYTHON=${PYTHON:-.venv/bin/python} PYTHONUNBUFFERED=1
parts=" ${PARTS:-doctor tests bits bench render overlap recipe} "
run=${RUN:-build/bench/gpu_run}
mkdir -p "$folder"
cores=$(env -u OMP_NUM_THREADS nproc) # which counts what OMP_NUM_THREADS says
threads=$(for k in 1 2 4 8 16 32; do [ "$k" -lt "$cores" ] && printf '%s,' "$k"; done)$cores
cli=(-c 'from sim2vr_harness.cli.main import main; main()')

# Run a part for at most $1 seconds; its output goes to $2.log, how it ended to summary.txt.
part() {
  local most=$1 name=$2 began left
  shift 2
  [[ $parts == *" $name "* ]] || return
  began=$(date +%s)
  left=$((ends - began))
  if [ "$left" -lt 10 ]; then
    echo "$name: not begun, no time left" | tee -a "$folder/summary.txt"
    return
  fi
  timeout -k 5 $((most < left ? most : left)) "$@" >"$folder/$name.log" 2>&1
  echo "$name: status $?, $(($(date +%s) - began)) s" | tee -a "$folder/summary.txt"
}

{
  date -u
  "$PYTHON" -c 'import torch; print("torch", torch.__version__, torch.cuda.is_available())'
  nvidia-smi --query-gpu=name,driver_version --format=csv,noheader
  grep -m 1 'model name' /proc/cpuinfo
  echo "$cores cores, load $(cut -d ' ' -f 1 /proc/loadavg)"
} >"$folder/summary.txt" 2>&1
part 60 doctor "$PYTHON" "${cli[@]}" doctor
part 90 tests "$PYTHON" -m pytest -p no:cacheprovider -m gpu tests/python/training
part 60 bits "$PYTHON" -m pytest -p no:cacheprovider tests/python/envs/test_simulation.py
part 100 bench "$PYTHON" tools/bench/bench.py --scene physics,env --n 64 --threads "$threads" \
  --seconds 2 --output "$folder/bench.jsonl"
part 60 render "$PYTHON" tools/bench/bench.py --scene render --n 64 --threads "$cores" --seconds 2
part 60 overlap "$PYTHON" tools/bench/overlap.py --threads "$cores" --seconds 2
part 480 recipe tools/bench/recipe.sh "$config" "$run"
part 300 suite "$PYTHON" -m pytest -p no:cacheprovider -n "$cores" tests/python/training tests/python/policies
{
  for each in tests bits suite; do
    [ -f "$folder/$each.log" ] && grep -hE '^FAILED|^SKIPPED.*(GPU|CUDA)|passed|failed' "$folder/$each.log"
  done
  for each in bench render; do
    [ -f "$folder/$each.log" ] && grep -E '^(physics|render|env)' "$folder/$each.log"
  done
  [ -f "$folder/overlap.log" ] && cat "$folder/overlap.log"
  if [ -f "$folder/recipe.log" ]; then
    grep -v Cycle "$folder/recipe.log"
    grep Cycle "$folder/recipe.log" | tail -n 2
    "$PYTHON" tools/bench/stages.py "$run"
  fi
} >>"$folder/summary.txt" 2>&1
cat "$folder/summary.txt"
