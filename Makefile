# Everything a contributor types. Needs Python 3.11 and make; the rest is fetched from PyPI and npm into this folder.
# Variables: PYTHON=python3.11, ARGS="--serial /dev/ttyUSB0" for `make run`, TESTS=tests/unit for `make test`,
# WORKERS=1 for one test process instead of two per core; for `make campaign` SHORT=1 (minutes), LONG=1 (hours), ONLY=soak.

PYTHON ?= $(firstword $(foreach p,python3.11 python3.12 python3.13 python3,$(if $(shell command -v $p 2>/dev/null),$p)))
ARGS ?=
LONG ?=
ONLY ?=
SHORT ?=
TESTS ?=
WORKERS ?= auto

VENV := .venv
PY := $(VENV)/bin/python
PIP := $(PY) -m pip --disable-pip-version-check install --quiet
export PYTHONDONTWRITEBYTECODE :=
export MPLBACKEND := Agg

.DEFAULT_GOAL := help
.PHONY: help run test pictures campaign check lint types imports generated-check c-check frontend-check bench mutation generated lock audit clean frontend browser wheels site engine

help: ## say what there is
	@awk -F':.*## ' '/^[a-z]+:.*## /{printf "make %-10s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

run: $(VENV)/.run-installed frontend ## set up what is missing, then serve the simulated accumulator on http://127.0.0.1:8000
	@exec $(VENV)/bin/voltwall serve $(ARGS)

test: $(VENV)/.dev-installed frontend browser ## set up what is missing, then run every test, in the browser too
	@$(PY) hatch_build.py npm run --silent test
	@$(PY) -m pytest -n $(WORKERS) --dist loadfile --no-loadscope-reorder $(TESTS)

pictures: $(VENV)/.dev-installed frontend browser ## take the pictures anew that the campaign compares the pages with
	@VOLTWALL_PICTURES=renew $(PY) -m pytest -q -n 0 tests/e2e/test_pictures.py
	@git status --short tests/e2e/pictures

campaign: $(VENV)/.site-installed frontend browser ## kills, power cuts, noise, a day of racing, every route, within 30 minutes; SHORT=1 for what make test leaves out, LONG=1 for hours
	@$(PY) .ci/campaign.py $(if $(SHORT),--short) $(if $(LONG),--long) $(if $(ONLY),--only $(ONLY))

check: lint types imports generated-check c-check frontend-check ## formatting, lint, workflows, types, import rules, generated files, the C library; changes nothing

lint: $(VENV)/.dev-installed
	$(PY) -m ruff format --check
	$(PY) -m ruff check
	$(VENV)/bin/actionlint

types: $(VENV)/.dev-installed
	$(PY) -m mypy
	$(PY) -m mypy --explicit-package-bases --disable-error-code import-not-found hatch_build.py .ci benchmarks

imports: $(VENV)/.dev-installed
	$(VENV)/bin/lint-imports

generated-check: $(VENV)/.dev-installed engine
	$(PY) .ci/generated.py --check

c-check: $(VENV)/.dev-installed
	$(PY) -m pytest -q -n 0 tests/static

frontend-check: $(VENV)/.dev-installed
	$(PY) hatch_build.py npm run --silent format:check
	$(PY) hatch_build.py npm run --silent lint
	$(PY) hatch_build.py npm run --silent check

bench: $(VENV)/.dev-installed frontend ## measure and print the figures, with their method
	@$(VENV)/bin/voltwall bench $(ARGS)

mutation: $(VENV)/.dev-installed ## change the protocol's code bit by bit: do the tests notice? (about an hour)
	@nice $(PY) .ci/mutation.py $(ARGS)

generated: $(VENV)/.dev-installed engine ## write the generated files anew: C header, command line reference, ...
	$(PY) .ci/generated.py

lock: | $(PY) ## resolve pyproject.toml anew into requirements/*.lock
	@$(PIP) uv==0.13.8
	$(PY) .ci/lock.py $(ARGS)

audit: | $(PY) $(VENV)/.build-installed ## known holes in what is locked: pip-audit and npm audit; needs the network
	@$(PY) .ci/audit.py

$(VENV)/.site-installed: requirements/site.lock | $(VENV)/.dev-installed
	@$(PIP) --require-hashes -r requirements/site.lock
	@touch $@

clean: ## remove everything that was fetched or built
	rm -rf mutants site $(VENV) frontend/node_modules app/static app/estimation/filters/engine/vw_filter*.so app/estimation/filters/engine/vw_filter*.dylib firmware_protocol/c/simulated/vw_firmware.so firmware_protocol/c/simulated/vw_firmware.dylib .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache

frontend: | $(VENV)/.build-installed
	@$(PY) hatch_build.py

engine: | $(VENV)/.dev-installed
	@$(PY) hatch_build.py engine

wheels: | $(VENV)/.build-installed ## one wheel for each platform, into dist/
	@$(PY) hatch_build.py wheels dist

site: $(VENV)/.site-installed ## the documentation as a site, into site/, with search and the Python API
	@NO_MKDOCS_2_WARNING=1 $(PY) -m mkdocs build --quiet --site-dir site $(ARGS)
	@echo "site/index.html; with search: $(PY) -m http.server --directory site"

browser: | $(VENV)/.dev-installed
	@$(PY) .ci/ensure_browser.py

$(PY):
	@test -n "$(PYTHON)" || { echo "Python 3.11 or newer is missing: install it or say PYTHON=/path/to/python3.11"; exit 1; }
	@$(PYTHON) -c 'import sys; sys.exit(f"$(PYTHON) is {sys.version.split()[0]}, Voltwall needs 3.11 or newer" if sys.version_info < (3, 11) else 0)'
	@echo "setting up $(VENV) (about a minute, once)"
	@$(PYTHON) -m venv $(VENV) || { rm -rf $(VENV); echo "$(PYTHON) cannot make environments (Debian: apt-get install python3-venv)"; exit 1; }

$(VENV)/.run-installed: requirements/run.lock requirements/build.lock pyproject.toml | $(PY)
	@$(PIP) --require-hashes -r requirements/run.lock -r requirements/build.lock
	@$(PIP) --no-deps --no-build-isolation --editable .
	@touch $@ $(VENV)/.build-installed

$(VENV)/.build-installed: requirements/build.lock | $(PY)
	@$(PIP) --require-hashes -r requirements/build.lock
	@touch $@

$(VENV)/.dev-installed: requirements/dev.lock pyproject.toml | $(PY)
	@$(PIP) --require-hashes -r requirements/dev.lock
	@$(PIP) --no-deps --no-build-isolation --editable .
	@$(PY) .ci/commit_subject.py --install
	@touch $@ $(VENV)/.build-installed
