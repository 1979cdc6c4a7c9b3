# make demo    a first result on shipped data, from nothing
# make test    the tests
# make quick   laws, inverses, a fit and a file of each maker: half a minute
# make thorough  the studies among the tests, which `make test` leaves out
# make pages   the code that docs/ and docstrings show, run as tests without building the pages
# make lint    formatting, style, import directions, types
# make docs    the documentation, its code run: out/docs/index.html
# make datasets   rewrites datasets/
# make picture    draws the first picture of the README again
# make package    a wheel and an sdist in build/, tried on the oldest and newest Python found, its types checked
# make targets    which judges of `hysid export --to` are here: simulators, importers, compilers
# make minimum    some tests with the lowest versions that pyproject.toml allows
# make bench   installs what benchmarks compare with and fuzz with, which `make test` does not need
# make clean   everything git does not hold, the environment included

PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
READY  := $(VENV)/.installed
DOCS_READY := $(VENV)/.installed-docs
WORKERS ?= 2

.PHONY: demo test quick thorough pages lint docs datasets picture package targets minimum bench clean

demo: $(READY)
	$(BIN)/hysid demo --out out/demo

test: $(READY)
	$(BIN)/python -m pytest -n $(WORKERS) --dist loadfile -q

QUICK := test_architecture.py test_hysteresis/test_trees.py \
	test_compensate/test_invert.py test_identify/test_fitting/test_fit.py test_hysid/test_intake/test_vendor_files.py

quick: $(READY)
	$(BIN)/python -m pytest -n $(WORKERS) --dist loadfile -q $(addprefix tests/,$(QUICK))

thorough: $(READY)
	$(BIN)/python -m pytest -n $(WORKERS) --dist loadfile -q -m thorough

pages: $(READY)
	$(BIN)/python -m pytest -n $(WORKERS) -q -m pages tests/test_docs.py tests/test_examples.py

lint: $(READY)
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/lint-imports
	@# pyright is a Node program that its Python wrapper downloads; without a network it is skipped, and says so.
	@if $(BIN)/pyright --version >/dev/null 2>&1; then $(BIN)/pyright; \
	else echo "lint: pyright cannot be had offline, types NOT checked" >&2; fi

docs: $(DOCS_READY) out/growth.svg
	$(BIN)/python -m sphinx -n -W --keep-going -q -j $(WORKERS) -b html -d out/.doctrees docs out/docs

# Peers are timed for it, so it is made once; `make clean` takes it away.
out/growth.svg: | $(READY)
	mkdir -p out
	$(BIN)/python -m benchmarks._preisach.growth_picture out/growth.svg

datasets: $(READY)
	$(BIN)/python -m benchmarks.datasets

picture: $(READY)
	$(BIN)/python docs/tools/picture.py

package:
	.ci/packaging

targets: $(READY)
	@$(BIN)/python -m tests.judges

minimum:
	.ci/packaging minimum

bench: $(READY)
	@if command -v uv >/dev/null 2>&1; then \
		set -ex; uv pip install --python $(BIN)/python --editable '.[dev,bench,fuzz]'; \
	else \
		set -ex; $(BIN)/python -m pip install --quiet --editable '.[dev,bench,fuzz]'; \
	fi

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

$(DOCS_READY): $(READY)
	@if command -v uv >/dev/null 2>&1; then \
		set -ex; uv pip install --python $(BIN)/python --editable '.[dev,docs]'; \
	else \
		set -ex; $(BIN)/python -m pip install --quiet --editable '.[dev,docs]'; \
	fi
	@touch $@

clean:
	rm -rf $(VENV) out build dist .hypothesis .pytest_cache .ruff_cache .import_linter_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
