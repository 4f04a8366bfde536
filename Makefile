# `make demo` and `make test` need only Python 3.11 or later and make; everything else goes into .venv.
PYTHON ?= python3
BIN := .venv/bin
JOBS ?= 2
export OPENBLAS_NUM_THREADS := 1

.PHONY: demo test slow check install clean

install: .venv/installed

.venv/installed: pyproject.toml
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "tbmslam needs Python 3.11 or later")'
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[dev]'
	touch $@

# Fails early and clearly when the style, the types or the layers are broken.
check: install
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports

test: install
	$(BIN)/python -m pytest -n $(JOBS) -m 'not slow'

slow: install
	$(BIN)/python -m pytest -n $(JOBS) -m slow

clean:
	rm -rf .venv demo out
