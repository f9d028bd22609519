#!/usr/bin/env bash
# Train and evaluate a recipe from nothing on this machine, and say how long each stage took.
#
#   tools/bench/recipe.sh [CONFIG] [FOLDER] [--set KEY=VALUE ...]
#
# PYTHON: the interpreter that has sim2vr-harness (default .venv/bin/python). Needs no network. On 16
# cores with a GPU the default recipe takes six minutes, on two cores without one twenty.
set -euo pipefail
config=${1:-configs/whacamole_constrained_distill.yaml}
folder=${2:-build/bench/recipe}
shift $(($# < 2 ? $# : 2))
python=${PYTHON:-.venv/bin/python}
begin=$(date +%s)
PYTHONUNBUFFERED=1 "$python" -c 'from sim2vr_harness.cli.main import main; main()' \
  train "$config" --out "$folder" --overwrite "$@" 2>&1 |
  while IFS= read -r line; do
    case $line in
      *' | '*) ;; # the line of progress
      *) printf '%5d s  %s\n' $(($(date +%s) - begin)) "$line" ;;
    esac
  done
