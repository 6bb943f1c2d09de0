# Two commands set everything up: `make demo` and `make test`. `make help` lists the rest.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
INSTALLED := $(VENV)/.installed
INSTALLED_DOCS := $(VENV)/.installed-docs
INSTALLED_BENCH := $(VENV)/.installed-bench
BENCH ?= --output benchmarks/results.md
METHODS ?= --output docs/benchmark
FUZZ ?= --count 50000
STUDY ?= --flights 300
MUTATIONS ?= --workers 2
CONSOLE ?= yes

.PHONY: help demo test lint types contracts bench methods fuzz study mutations fleet docs package samples check check-all clean

help:  ## List the targets
	@grep -E '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:[^#]*## /\t/'

$(INSTALLED): pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "quadid-logs needs Python 3.11 or newer; try: make PYTHON=python3.12 $(MAKECMDGOALS)" >&2; exit 1; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade pip
	$(BIN)/python -m pip install --quiet --editable '.[dev]'
	@touch $@

$(INSTALLED_DOCS): pyproject.toml
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --editable '.[docs]'
	@touch $@

$(INSTALLED_BENCH): pyproject.toml
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --editable '.[bench,parquet]'
	@touch $@

demo: $(INSTALLED)  ## Simulate a flight, analyze it, say where the report is
	$(BIN)/quadid-log simulate sysid-quad-x -o demo/flight.bin --force
	$(BIN)/quadid-log analyze demo/flight.bin -o demo/report --force
	@echo "Open demo/report/flight/report.html in a browser."

test: $(INSTALLED)  ## Run the tests
	$(BIN)/python -m pytest -q -n auto --dist loadfile

lint: $(INSTALLED)  ## Style and format
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(INSTALLED)  ## Strict types
	$(BIN)/mypy

contracts: $(INSTALLED)  ## Import contracts
	$(BIN)/lint-imports

bench: $(INSTALLED)  ## Speed and memory against the reference readers; BENCH=--short for a quick look
	$(BIN)/python benchmarks/run.py $(BENCH)

methods: $(INSTALLED_BENCH)  ## Every method on every data set, and the benchmark page's tables; METHODS='--export DIR' writes the data sets
	$(BIN)/python -m benchmarks.methods $(METHODS)

fuzz: $(INSTALLED)  ## Random damage against every reader and the whole analysis; FUZZ='--minutes 5'
	$(BIN)/python fuzz/run.py $(FUZZ)

study: $(INSTALLED)  ## Coverage of the intervals over simulated flights; STUDY='--flights 60' for a short look, STUDY='--tune' for tuning, STUDY='--promise' for promises
	$(BIN)/python study/run.py $(STUDY)

mutations: $(INSTALLED)  ## Plausible mistakes, one at a time: which do the tests notice? MUTATIONS='--only intervals'
	$(BIN)/python benchmarks/mutation_check.py $(MUTATIONS)

fleet: $(INSTALLED)  ## 500 logs of 20 vehicles: speed, change points, and what kills and restarts leave
	$(BIN)/python benchmarks/fleet.py $(FLEET)

docs: $(INSTALLED_DOCS)  ## Run the tutorials' commands and build the documentation into site/; CONSOLE= leaves the pages' output as it is
	$(if $(CONSOLE),$(BIN)/python docs/console.py)
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet

package:  ## Build the wheel, install it into an empty environment and run it there
	@PYTHON=$(PYTHON) bash .ci/package

samples: $(INSTALLED)  ## Write sample_logs/ anew with our own simulator
	$(BIN)/python sample_logs/make.py

check: lint types contracts test  ## All that must hold before a commit

check-all: check  ## And the long studies, every log, and that the lists of mistakes fit the code
	HYPOTHESIS_PROFILE=random $(BIN)/python -m pytest -q -n auto --dist loadfile -m 'source_text or thorough or property'

clean:  ## Remove what was generated
	rm -rf $(VENV) demo site build dist .pytest_cache .mypy_cache .ruff_cache .hypothesis
