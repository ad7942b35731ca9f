# Two commands do everything on a machine that has Python 3.11 or later and make: `make run` and `make test`.
PYTHON ?= $(firstword $(shell command -v python3.11 python3))
VENV ?= .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip --quiet --disable-pip-version-check

# Byte code is kept, else each of the many processes of the tests would translate all packages again.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: run test lint docs bench fuzz mutation nightly clean help

run: $(VENV)/.run  ## install, then simulate, map and score a run; the last line is the path of the report
	$(BIN)/testbed run office

test: $(VENV)/.test  ## install with the test dependencies, compile the kernels, then run the fast tests on all cores
	$(BIN)/testbed warmup
	$(BIN)/python -m pytest -n auto --dist worksteal

lint: $(VENV)/.lint  ## check style, types and import rules
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	$(BIN)/lint-imports

docs: $(VENV)/.docs  ## make a site of the documentation, with the API: build/site/index.html
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict --quiet --config-file tools/docs/site/mkdocs.yml
	@echo $(CURDIR)/build/site/index.html

bench: $(VENV)/.test  ## run the benchmarks, which are never part of the tests
	$(BIN)/python -m pytest -m benchmark
	$(BIN)/python -m tools.measure.engine_cost
	$(BIN)/python -m tools.measure.measure_datasets

FUZZ_SECONDS ?= 60
fuzz: $(VENV)/.test $(VENV)/.nightly  ## fuzz all readers for a minute (FUZZ_SECONDS)
	$(BIN)/python -m tests.fuzz --seconds $(FUZZ_SECONDS)

mutation: $(VENV)/.test $(VENV)/.nightly  ## change the code in one place at a time; list the changes that no test notices (hours)
	$(BIN)/python -m tools.measure.mutation runs/mutation

nightly: $(VENV)/.test $(VENV)/.nightly  ## what takes a night: an hour of fuzzing, soak tests, laws on many examples, mutation testing
	$(BIN)/python -m tests.fuzz --seconds 3600 --corpus runs/fuzz
	$(BIN)/python -m pytest -m nightly
	$(BIN)/python -m pytest -n auto --dist worksteal --timeout 3600 --hypothesis-profile deep
	$(BIN)/python -m tools.measure.mutation runs/mutation

clean:  ## remove the environment, all runs and built packages
	rm -rf $(VENV) runs build dist

help:  ## list the targets
	@sed -n 's/^\([a-z]*\):[^#]*## /  make \1\t/p' $(MAKEFILE_LIST)

$(VENV)/.run $(VENV)/.test $(VENV)/.lint $(VENV)/.docs $(VENV)/.nightly: $(VENV)/.%: pyproject.toml | $(BIN)/python
	$(PIP) install --editable '.$(if $(filter-out run,$*),[$*])'
	touch $@

$(BIN)/python:
	$(PYTHON) -m venv $(VENV)
