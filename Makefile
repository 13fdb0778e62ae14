# On a fresh machine with python3 and make, start with `make demo` or `make test`.

PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
DEMO ?= runs/demo

.PHONY: help demo test test-all fuzz kills mutants lint docs wheel bench memory pictures notebooks install clean

help:  ## list all commands
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:[^#]*## /\t/' | expand -t 14

demo: $(VENV)/.installed  ## an agent recovers its body and plans motions: two minutes on two cores
	$(BIN)/selftouch run cube --out $(DEMO)

test: $(VENV)/.installed-test  ## run the tests: minutes on two cores
	$(BIN)/python -m pytest -n auto --dist loadfile -m "not slow"

test-all: test  ## run the slow tests too: notebooks, site, browser, robots, benchmarks
	$(BIN)/python -m pytest -n auto --dist worksteal -m slow

fuzz: $(VENV)/.installed-test  ## give thousands of broken inputs to all parsers
	SELFTOUCH_FUZZ=1000 $(BIN)/python -m pytest tests/test_fuzz.py -n 0 -s

kills: $(VENV)/.installed  ## kill every stage at random moments, fifty times, and compare resumed runs
	$(BIN)/python benchmarks/make/kills.py

lint: $(VENV)/.installed-dev  ## check style and types
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy

docs: $(VENV)/.installed-docs  ## build the documentation, with a reference from the code: site/index.html
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet

wheel: $(VENV)/bin/python  ## build the package into dist
	$(BIN)/python -m pip wheel --quiet --no-deps --wheel-dir dist .

mutants: $(VENV)/.installed-test  ## break one line at a time, and count who notices: an hour
	$(BIN)/python benchmarks/make/mutants.py

bench: $(VENV)/.installed-bench  ## measure speed and memory beside alternatives, and with BEFORE=PATH beside another checkout
	$(BIN)/python benchmarks/cost/table.py $(if $(BEFORE),--before "$(BEFORE)")

pictures: $(VENV)/.installed-test  ## redraw all pictures of README and documentation: half an hour
	$(BIN)/python benchmarks/make/pictures.py

notebooks: $(VENV)/.installed-test  ## run all notebooks and store their outputs: ten minutes
	$(BIN)/python benchmarks/make/notebooks.py

memory: $(VENV)/.installed  ## measure peak memory of every stage, at a million touches and at ten
	$(BIN)/python benchmarks/cost/memory.py $(RUN)

install: $(VENV)/.installed  ## install the package into .venv

$(VENV)/bin/python:
	@$(PYTHON) -c 'import sys; v = sys.version_info[:2]; sys.exit(not (3, 11) <= v <= (3, 14))' || \
	  { echo 'Python 3.11 to 3.14 is needed; name one with `make PYTHON=python3.12 ...`'; exit 1; }
	@$(PYTHON) -m venv $(VENV) || { rm -rf $(VENV); \
	  echo 'Python cannot make a virtual environment; try `sudo apt install python3-venv`'; exit 1; }

$(VENV)/.installed: $(VENV)/bin/python pyproject.toml constraints.txt
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable .
	@$(BIN)/python -c 'import pydrake.common' || \
	  { echo 'Drake misses a library of the system; try `sudo apt install libglib2.0-0`'; exit 1; }
	@touch $@

$(VENV)/.installed-test: $(VENV)/.installed
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable '.[test]'
	@touch $@

$(VENV)/.installed-dev: $(VENV)/.installed-test
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable '.[test,dev]'
	@touch $@

$(VENV)/.installed-docs: $(VENV)/.installed
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable '.[docs]'
	@touch $@

$(VENV)/.installed-bench: $(VENV)/.installed
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable '.[bench]'
	@touch $@

clean:  ## remove the environment, keep the runs
	rm -rf $(VENV)
