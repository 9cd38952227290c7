# make demo: set up and do the whole job on bundled materials.   make test: set up and pass the tests.
# make thorough: all of them, the long ones too, every program compiled as users have it.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
# By environment, so that the build of gonio itself is pinned too: older pips read the first, newer ones the second.
PIP := PIP_CONSTRAINT=constraints.txt PIP_BUILD_CONSTRAINT=constraints.txt \
	$(BIN)/python -m pip install --quiet --disable-pip-version-check

.PHONY: demo test thorough lint types clean

demo: $(VENV)/.installed
	$(BIN)/gonio demo

# One thread of linear algebra for each worker: those of several wait for each other in turns, ten times as long.
# To rewrite all assertions takes seconds in each worker: those of the tests that failed show their values in a second run.
test: $(VENV)/.installed-tests
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -n auto --dist worksteal --assert=plain || \
		{ $(BIN)/python -m pytest --last-failed --last-failed-no-failures none; exit 1; }

# All tests, with the long ones and every setting.
thorough: $(VENV)/.installed-tests
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -n auto --dist worksteal -m ''

lint: $(VENV)/.installed-tests types
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

# The type checker reads folders: here the four are laid as the one package that they install as.
types: $(VENV)/.installed-tests
	rm -rf build/types && mkdir -p build/types/gonio
	ln -s $(CURDIR)/gonio/* $(CURDIR)/models $(CURDIR)/fitting $(CURDIR)/data build/types/gonio/
	$(BIN)/pyright

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
		{ echo "gonio needs Python 3.11 or later; set PYTHON to one, as in: make PYTHON=python3.12 $(MAKECMDGOALS)"; exit 1; }
	$(PYTHON) -m venv $(VENV)

$(VENV)/.installed: pyproject.toml constraints.txt | $(BIN)/python
	$(PIP) --editable .
	@touch $@

$(VENV)/.installed-tests: pyproject.toml constraints.txt | $(BIN)/python
	$(PIP) --editable '.[test]'
	@touch $@ $(VENV)/.installed

clean:
	rm -rf $(VENV) build *.egg-info .pytest_cache .ruff_cache .hypothesis
