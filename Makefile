# make demo    a first result on shipped data, from nothing
# make test    the tests
# make lint    formatting, style, import directions, types
# make docs    the pages of docs/ with the figures their code draws
# make datasets   rewrites datasets/
# make clean   everything git does not hold, the environment included

PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
READY  := $(VENV)/.installed
WORKERS ?= 2

.PHONY: demo test lint docs datasets clean

demo: $(READY)
	$(BIN)/hysid demo --out out/demo

test: $(READY)
	$(BIN)/python -m pytest -n $(WORKERS) --dist loadfile -q

lint: $(READY)
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/lint-imports
	@# pyright is a Node program that its Python wrapper downloads; without a network it is skipped, and says so.
	@if $(BIN)/pyright --version >/dev/null 2>&1; then $(BIN)/pyright; \
	else echo "lint: pyright cannot be had offline, types NOT checked" >&2; fi

docs: $(READY)
	$(BIN)/python docs/build.py
	$(BIN)/python -m benchmarks._growth_picture out/docs/growth.svg

datasets: $(READY)
	$(BIN)/python -m benchmarks.datasets

# Again only when pyproject.toml changes: a second run needs no network.
$(READY): pyproject.toml
	@if command -v uv >/dev/null 2>&1; then \
		set -ex; \
		test -x $(BIN)/python || uv venv --python '$(PYTHON)' $(VENV); \
		uv pip install --python $(BIN)/python --editable '.[dev]'; \
	else \
		set -ex; \
		test -x $(BIN)/python || '$(PYTHON)' -m venv $(VENV); \
		$(BIN)/python -m pip install --quiet --editable '.[dev]'; \
	fi
	@touch $@

clean:
	rm -rf $(VENV) out build dist .hypothesis .pytest_cache .ruff_cache .import_linter_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
