#   make demo     simulate a cradle, then calibrate an example experiment
#   make test     the tests
#   make slow     the tests that take minutes
#   make fuzz     try to break the program; about an hour, results in studies/fuzz/results.md
#   make instructions  machine instructions of the kernel against those kept (needs Valgrind); ten minutes
#   make lint     style, types, and who may import whom
#   make docs     the documentation, in build/docs; the first time it runs the tutorials, some minutes
#   make clean    remove what these made
# Whichever comes first makes a virtual environment, with PYTHON=... if given. JOBS=... sets the test workers.

VENV := .venv
BIN := $(VENV)/bin
JOBS ?= auto
PYTEST := $(BIN)/python -m pytest --numprocesses $(JOBS) --maxprocesses 8 --dist loadfile --durations 15 --durations-min 5

# Python compiles what it imports: not all that pip installs, which takes half of its time.
INSTALL := $(BIN)/python -m pip install -qq --disable-pip-version-check --no-compile --editable

# An environment whose interpreter has been removed or upgraded away starts over.
$(if $(realpath $(BIN)/python),,$(shell rm -rf $(VENV)))

.PHONY: demo test slow fuzz instructions lint docs clean
.NOTPARALLEL:

demo: $(VENV)/.installed
	$(BIN)/python examples/demo.py

test: $(VENV)/.installed-dev
	@$(BIN)/cradle warmup
	$(PYTEST)

slow: $(VENV)/.installed-dev
	@$(BIN)/cradle warmup
	$(PYTEST) -m slow

fuzz: $(VENV)/.installed-dev
	$(BIN)/python -m studies.fuzz

instructions: $(VENV)/.installed-dev
	$(BIN)/python -m studies.instructions

lint: $(VENV)/.installed-dev
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/lint-imports --no-logo
	$(BIN)/pyright --pythonpath $(BIN)/python

docs: $(VENV)/.installed-docs
	PATH="$(abspath $(BIN)):$$PATH" $(BIN)/python -m sphinx -W --keep-going -q -b html docs build/docs
	@echo "Open build/docs/index.html"

clean:
	rm -rf $(VENV) build dist out .pytest_cache .ruff_cache .hypothesis .import_linter_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

$(VENV)/.installed: pyproject.toml | $(BIN)/python
	@echo "Installing newtons-cradle into $(VENV) (a minute or two, once)"
	@$(INSTALL) .
	@$(BIN)/cradle warmup
	@touch $@

# It compiles no kernels: the tests do, once for all workers, while CI runs lint. A demo after lint alone compiles what it
# needs.
$(VENV)/.installed-dev: pyproject.toml | $(BIN)/python
	@echo "Installing newtons-cradle and its test tools into $(VENV) (a minute or two, once)"
	@$(INSTALL) '.[dev]'
	@touch $(VENV)/.installed $@

$(VENV)/.installed-docs: pyproject.toml | $(BIN)/python
	@echo "Installing newtons-cradle and its documentation tools into $(VENV) (a minute or two, once)"
	@$(INSTALL) '.[docs]'
	@$(BIN)/cradle warmup
	@touch $(VENV)/.installed $@

# Named versions first: a python3 newer than these may lack wheels of some dependency.
$(BIN)/python:
	@for python in $(or $(PYTHON),python3.14 python3.13 python3.12 python3.11 python3 python); do \
	  "$$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null || continue; \
	  "$$python" -c 'import ensurepip, venv' 2>/dev/null || { without="$$without $$python"; continue; }; \
	  echo "Creating $(VENV) with $$("$$python" --version)"; \
	  "$$python" -m venv $(VENV) && exit; \
	  rm -rf $(VENV); \
	  exit 1; \
	done; \
	echo "No usable Python >= 3.11 here. Install one, or name it: make PYTHON=/path/to/python3" >&2; \
	[ -z "$$without" ] || echo "Without venv or ensurepip:$$without (Debian, Ubuntu: apt install python3-venv)" >&2; \
	exit 1
