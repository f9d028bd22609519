#!/usr/bin/env bash
# Regenerates the type stub of the extension module; a test compares it in CI.
set -euo pipefail
cd "$(dirname "$0")/../.."
out=$(mktemp -d)
trap 'rm -rf "$out"' EXIT
.venv/bin/pybind11-stubgen sim2vr_harness._app_runtime --output-dir "$out" --numpy-array-use-type-var
install -m 644 "$out/sim2vr_harness/_app_runtime.pyi" "${1:-python/sim2vr_harness/_app_runtime.pyi}"
