# Needs Python 3.11 to 3.14 and make. `make demo PYTHON=python3.12` chooses the interpreter.
PYTHON ?= python3
VENV := .venv
WEB := requirements/web
SCRIPTS := $(WEB) vdfmu/study/report/web
BIN := $(VENV)/bin
# Modules are compiled when they are imported: few of the 13,000 are.
PIP_INSTALL := -m pip install --quiet --disable-pip-version-check --no-compile
# Each process begins with an equal part of the tests, in their order: what the tests of a file share is made once.
PYTEST := -m pytest --dist worksteal
MARKS := not heavy
LINT_WEB := lint-web

# Hundreds of tests start a Python, which compiles 400 modules, 0.8 s, where it may not keep them. Threads of OpenBLAS
# would wait for each other, as each core has a test.
unexport PYTHONDONTWRITEBYTECODE
export OPENBLAS_NUM_THREADS := 1

.PHONY: demo test test-core test-memory test-all test-lowest hostile mutants claims bench docs lint lint-web pages sbom audit release lock vendor clean

demo: $(VENV)/demo  ## run the paper's tracking simulation (Section IV-B)
	$(BIN)/vdfmu run tracking

test: $(VENV)/test  ## run the tests, except for the heavy ones: some minutes
	$(BIN)/python $(PYTEST) -n 2 -m "$(MARKS)" $(PYTEST_ARGS)

# Tests of the documentation stay behind: its pages describe the extras too.
CORE := $(CURDIR)/$(VENV)/core

test-core: $(VENV)/test  ## run the tests on a copy without the extras, which the core does not need
	rm -rf $(CORE) && mkdir $(CORE)
	git ls-files | grep -v -e ^vdfmu/extras/ -e ^tests/extras/ -e ^tests/docs/test_ | tar -cT - | tar -xC $(CORE)
	cd $(CORE) && PYTHONPATH=$(CORE) $(CURDIR)/$(BIN)/python $(PYTEST) -n 2 -m "$(MARKS)" $(PYTEST_ARGS)

test-all: test test-core $(VENV)/platforms  ## run the heavy ones too: all platforms, emulators, sanitizers, C++ templates, installs
	$(BIN)/python $(PYTEST) -n 3 -m heavy $(PYTEST_ARGS)

# The compiler of the system: the guard needs nothing else. What tests start has it too.
GUARD := $(CURDIR)/$(VENV)/guard.so
MEMORY := tests/engine/test_memory.py tests/engine/test_ends.py tests/study/test_loaded.py

test-memory: $(VENV)/test  ## run tests of FMUs in processes where freed memory is closed or overwritten (Linux): a minute
	cc -std=c11 -shared -fPIC -o $(GUARD) tests/engine/guard.c
	LD_PRELOAD=$(GUARD) MALLOC_PERTURB_=165 $(BIN)/python $(PYTEST) -n 2 -m "not heavy or smoke" $(MEMORY)

# In an environment of its own. .ci/run does not: the versions change only with pyproject.toml.
test-lowest: $(VENV)/supply  ## run the tests, except for the heavy ones, with the lowest versions that pyproject.toml allows
	$(PYTHON) -m venv $(VENV)/lowest
	sed -n 's/^requires = \["\(.*\)"\]/\1/p' pyproject.toml | $(VENV)/tools/bin/uv pip compile --quiet - pyproject.toml \
		--extra test --extra notebook --resolution lowest-direct --only-binary :all: --generate-hashes \
		--python $(VENV)/lowest/bin/python --output-file $(VENV)/lowest.txt
	$(VENV)/lowest/bin/python $(PIP_INSTALL) --require-hashes -r $(VENV)/lowest.txt --no-deps
	$(VENV)/lowest/bin/python $(PIP_INSTALL) --no-deps --no-build-isolation -e .
	$(VENV)/lowest/bin/python $(PYTEST) -n 2 -m "not heavy" $(PYTEST_ARGS)

hostile: $(VENV)/test  ## try thousands of hostile inputs, print what came of them: minutes
	$(BIN)/python -m tests.hostile --write docs/robustness.md

mutants: $(VENV)/test  ## seed 60 faults at random and see whether make test finds them: hours; MUTANTS="COUNT SEED WORD"
	$(BIN)/python -m tests.mutants $(MUTANTS)

claims: $(VENV)/test  ## run the commands behind the figures of README and docs, print found beside claimed: minutes
	$(BIN)/python -m tests.docs.claims $(CLAIMS)

bench: $(VENV)/test  ## measure times
	$(BIN)/python -m benchmarks

docs: $(VENV)/docs  ## build the documentation into site/VERSION, beside other versions; a warning is an error
	$(BIN)/python docs/make.py $(DOCS_ARGS)

# Types are resolved in what the tests install: the packages of all extras.
lint: $(VENV)/test $(VENV)/dev $(if $(shell command -v npm),$(LINT_WEB))  ## ruff, pyright, warnings about wording and, with npm, lint-web
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright --pythonpath $(BIN)/python
	$(BIN)/python docs/words.py

lint-web: $(WEB)/node_modules  ## types, eslint and prettier on the scripts of the pages; needs node and npm
	$(WEB)/node_modules/.bin/tsc --project $(WEB)/tsconfig.json
	$(WEB)/node_modules/.bin/eslint --config $(WEB)/eslint.config.mjs $(SCRIPTS)
	$(WEB)/node_modules/.bin/prettier --print-width 100 --check $(SCRIPTS)

sbom: $(VENV)/listed $(VENV)/supply  ## write dist/sbom.cdx.json: what is installed with vdfmu[native], as CycloneDX
	mkdir -p dist
	$(VENV)/tools/bin/cyclonedx-py environment $(VENV)/user/bin/python --pyproject pyproject.toml --output-reproducible \
		--output-format JSON --output-file dist/sbom.cdx.json

# A known vulnerability fails; a service that cannot be reached does not, and is said.
audit: $(VENV)/supply  ## ask for known vulnerabilities of the versions in constraints.txt
	mkdir -p dist && rm -f dist/audit.json
	$(VENV)/tools/bin/pip-audit -r constraints.txt --no-deps --disable-pip --progress-spinner off \
		--format json --output dist/audit.json || test ! -s dist/audit.json
	@$(BIN)/python -c "import json, os; \
		found = json.load(open('dist/audit.json'))['dependencies'] if os.path.exists('dist/audit.json') else []; \
		print(sum('vulns' in one for one in found), 'of', len(found), 'packages were found at the advisory service')"

release: sbom $(VENV)/test  ## write dist/vdfmu-VERSION: wheel, sdist, FMUs and packages of all arms, checksums
	$(BIN)/python release.py $(RELEASE_ARGS)

lock: $(VENV)/supply  ## choose the versions and write their hashes; LOCK=--upgrade takes the newest
	$(VENV)/tools/bin/python requirements/lock.py $(LOCK)

pages: $(WEB)/node_modules  ## pack the scripts and styles of the pages, three.js and uPlot; needs node and npm
	node $(WEB)/build.mjs

vendor: pages $(VENV)/test  ## put what pages need into the package: scripts, and elementary functions
	$(BIN)/python requirements/wasm/build.py

clean:  ## remove the environment and all that was built
	rm -rf $(VENV) build dist site results .pytest_cache .ruff_cache .hypothesis

# A stamp file for each extra: installed anew only when the dependencies change. Their files are held against hashes,
# which the project has none of: it comes by itself. The install is editable, so that a change of the sources needs none.
$(VENV)/python:
	$(PYTHON) -c "import sys; sys.exit(not (3, 11) <= sys.version_info < (3, 15) and 'make needs Python 3.11 to 3.14, for \
	which the versions in constraints.txt have files: make PYTHON=...; on a later one install \".[native]\" by pip')"
	$(PYTHON) -m venv $(VENV)
	touch $@

$(VENV)/demo: EXTRA := native
$(VENV)/test $(VENV)/docs $(VENV)/dev: EXTRA = $(@F)
$(VENV)/demo $(VENV)/test $(VENV)/docs $(VENV)/dev: $(VENV)/python pyproject.toml $(wildcard requirements/*.txt)
	$(BIN)/python $(PIP_INSTALL) --require-hashes -r requirements/$(EXTRA).txt
	$(BIN)/python $(PIP_INSTALL) --no-deps --no-build-isolation -e .
	touch $@

# An environment of its own: $(VENV) may have the packages of the tests too.
$(VENV)/listed: $(VENV)/python requirements/base.txt requirements/native.txt
	$(PYTHON) -m venv $(VENV)/user
	$(VENV)/user/bin/python $(PIP_INSTALL) --require-hashes -r requirements/native.txt
	touch $@

$(VENV)/supply: $(VENV)/python requirements/supply.txt
	$(PYTHON) -m venv $(VENV)/tools
	$(VENV)/tools/bin/python $(PIP_INSTALL) --require-hashes -r requirements/supply.txt
	touch $@

# The versions are those of package-lock.json, held against hashes.
$(WEB)/node_modules: $(WEB)/package-lock.json
	npm --prefix $(WEB) ci --ignore-scripts --no-audit --no-fund
	touch $@

$(VENV)/platforms: $(VENV)/test
	@echo "preparing the compiler for all platforms: minutes the first time"
	$(BIN)/python tests/prepare.py
	touch $@
