# Each target does all of its own set-up (scripts/setup.sh), which is quick when it stands.
PYTHON := .venv/bin/python

.PHONY: help setup run test check bench format lock

help:
	@echo "make setup   .venv with locked dependencies and weldcell in it"
	@echo "make run     the main job: weldcell run commission (ARGS='--robot paper' adds options)"
	@echo "make test    all tests"
	@echo "make check   format, lint, types, import rules, tests"
	@echo "make bench   benchmarks: a table and benchmarks/results.json"
	@echo "make format  put the code into the project's format"
	@echo "make lock    bring requirements.lock up to date with pyproject.toml"

setup:
	@scripts/setup.sh

run: setup
	.venv/bin/weldcell run commission --overwrite $(ARGS)

# One process for each core: the linear algebra's own threads would only wait for each other.
test: setup
	OPENBLAS_NUM_THREADS=1 $(PYTHON) -m pytest --numprocesses=auto --maxprocesses=4 --dist=loadfile $(ARGS)

check: setup
	.venv/bin/ruff format --check
	.venv/bin/ruff check
	.venv/bin/mypy
	.venv/bin/lint-imports
	@$(MAKE) --no-print-directory test

bench: setup
	$(PYTHON) -m benchmarks $(ARGS)

format: setup
	.venv/bin/ruff format
	.venv/bin/ruff check --fix

lock: setup
	@scripts/lock.sh
