# sim2vr: everything a newcomer needs is `make play`, `make train` and `make test`.

SHELL       := /bin/bash
.SHELLFLAGS := -eu -o pipefail -c
.DEFAULT_GOAL := help

VENV      := .venv
CONFIG    ?= configs/whacamole_constrained_distill.yaml
TIMESTEPS ?=
PLAYER    ?= whacamole_constrained
CONDITION ?= medium
RUN       ?= runs/$(basename $(notdir $(CONFIG)))
PARTS     ?=
ROWS      ?= build/bench/performance.jsonl
BENCH      = $(VENV)/bin/python tools/bench/bench.py --output $(ROWS)

.PHONY: help setup train play docs check test nightly format stubs lock reference wheel bench golden clean distclean

help:  ## Show this list
	@awk -F ':.*## ' '/^[a-z -]+:.*## / { printf "  make %-10s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)

setup:  ## Install everything: system packages, .venv, Python packages, C++ build
	@tools/dev/setup.sh

train: setup  ## Train and evaluate a simulated user (CONFIG=, TIMESTEPS=, RUN=); goes on with a run that is there
	$(VENV)/bin/sim2vr-harness train $(if $(wildcard $(RUN)/config.yaml),--resume,$(CONFIG)) $(if $(TIMESTEPS),--timesteps $(TIMESTEPS)) --out $(RUN)

play: setup  ## Let a trained user that ships play a round, and film it (PLAYER=, CONDITION=)
	$(VENV)/bin/sim2vr-harness evaluate pretrained:$(PLAYER) --condition $(CONDITION) --episodes 1 --record

check test: setup  ## Check it as CI does: format, lint, types, C++ and Python tests (PARTS=, PYTEST_ARGS=)
	@SIM2VR_PARTS="$(PARTS)" tools/dev/check.sh $(PYTEST_ARGS)

nightly: setup  ## What takes too long for every commit (PARTS=): sanitizers, fuzzing, slow trainings, wheels ...
	@tools/dev/nightly.sh $(PARTS)

format: setup  ## Rewrite the sources in the house style
	$(VENV)/bin/ruff check --fix-only .
	$(VENV)/bin/ruff format .
	$(VENV)/bin/clang-format -i $$(git ls-files '*.cpp' '*.hpp')

stubs: setup  ## Regenerate python/sim2vr_harness/_app_runtime.pyi
	@tools/dev/stubs.sh

reference: setup  ## Write the generated pages of docs/reference from the package
	$(VENV)/bin/python tools/docs/reference.py

docs: setup  ## Build the documentation's site, build/docs/index.html, with sample reports; dead links are errors
	$(VENV)/bin/python -m sphinx -q -W --keep-going -t samples -b html docs build/docs
	@echo build/docs/index.html

lock: setup  ## Regenerate requirements.lock from pyproject.toml
	$(VENV)/bin/python tools/dev/lock.py

wheel: setup  ## Make one portable wheel in dist/, users included, for other machines (PYTHON=)
	@tools/dev/wheel.sh

bench: setup  ## Measure this machine and write the tables of docs/evidence/training_and_speed.md (some seven minutes)
	mkdir -p build/bench
	rm -f $(ROWS)
	$(BENCH) --seconds 5 --train-steps 4000
	$(BENCH) --scene physics,env,memory --n 1,4,16,64,256,512 --threads 1,$$(nproc) --seconds 4
	$(BENCH) --scene render,env --transport all --n 1,8 --seconds 3
	$(BENCH) --scene senses --seconds 3
	$(VENV)/bin/python tools/bench/tables.py $(ROWS) docs/evidence/training_and_speed.md

golden: setup  ## Compare what the commands do with tests/golden, to the bit (NAMES=)
	$(VENV)/bin/python tests/golden/golden.py compare --bits $(NAMES)

clean:  ## Remove build outputs
	rm -rf build dist python/sim2vr_harness/_app_runtime*.so .pytest_cache .mypy_cache .ruff_cache
	find python tests tools -name __pycache__ -type d -prune -exec rm -rf {} +

distclean: clean  ## Remove build outputs and .venv (runs/ stays)
	rm -rf $(VENV)
