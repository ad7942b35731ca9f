# Two commands do everything on a machine that has Python 3.11 and make: `make run` and `make test`.
PYTHON ?= $(firstword $(shell command -v python3.11 python3))
VENV ?= .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip --quiet --disable-pip-version-check

.PHONY: run test lint bench clean help

run: $(VENV)/.run  ## install, then simulate, map and score a run; the last line is the path of the report
	$(BIN)/testbed run office

test: $(VENV)/.test  ## install with the test dependencies, then run the fast tests on all cores
	$(BIN)/python -m pytest -n auto

lint: $(VENV)/.lint  ## check style, types and import rules
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	$(BIN)/lint-imports

bench: $(VENV)/.test  ## run the benchmarks, which are never part of the tests
	$(BIN)/python -m pytest -m benchmark
	$(BIN)/python -m tools.measure.measure_datasets

clean:  ## remove the environment, all runs and built packages
	rm -rf $(VENV) runs build dist

help:  ## list the targets
	@sed -n 's/^\([a-z]*\):[^#]*## /  make \1\t/p' $(MAKEFILE_LIST)

$(VENV)/.run $(VENV)/.test $(VENV)/.lint: $(VENV)/.%: pyproject.toml | $(BIN)/python
	$(PIP) install --editable '.$(if $(filter-out run,$*),[$*])'
	touch $@

$(BIN)/python:
	$(PYTHON) -m venv $(VENV)
