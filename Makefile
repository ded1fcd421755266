# Two commands: `make figures` runs the bundled study, `make test` runs the tests.
# Both build a private environment in .venv from the hash-pinned lock files, with uv if it is installed.

CONFIG ?= config/config.yaml
CORES  ?= 2
VENV   ?= .venv
PYTEST_ARGS ?=

# The lock files are tested with Python 3.11 to 3.13; a newer Python is used only if none of these is found.
PYTHON ?= $(shell for limit in 3,14 4,0; do for p in python3 python3.13 python3.12 python3.11; do \
	"$$p" -c "import sys; sys.exit(not (3, 11) <= sys.version_info < ($$limit))" 2>/dev/null \
	&& { echo "$$p"; exit; }; done; done)
BIN := $(VENV)/bin
# Keep other environments out of the private one, and let jobs cache the bytecode of their imports.
export PYTHONNOUSERSITE := 1
unexport PYTHONPATH PYTHONDONTWRITEBYTECODE

.PHONY: figures figures-told dissertation dissertation-docs both-sides test test-lowest test-cluster fuzz chaos mutants benchmarks integrator lint lint-types lint-style format rules docs site sample lock release clean help

help:
	@echo "make figures    run the study in CONFIG ($(CONFIG)) on CORES ($(CORES)) cores"
	@echo "make dissertation  set each result of the dissertation beside hopdata's: results/dissertation/index.html"
	@echo "make dissertation-docs  the same, and write its table to docs/dissertation.md"
	@echo "make test       run all tests (PYTEST_ARGS='-k name' selects)"
	@echo "make test-lowest  the same, with the oldest versions that pyproject.toml allows (Python 3.11, in $(VENV)-lowest)"
	@echo "make test-cluster  run studies on a SLURM of three nodes on this machine, kill jobs and nodes (as root, with slurm-wlm)"
	@echo "make fuzz       look for inputs that break a promise, for MINUTES ($(MINUTES)) on CORES cores (SEED, DOORS='c3d mat' selects)"
	@echo "make chaos      kill, starve and damage a small study EVENTS times (1000), SEED (1); goes on where it was interrupted"
	@echo "make mutants    make small wrong changes and see which of them the tests miss (takes hours; can be interrupted)"
	@echo "make both-sides run the study of the dissertation's size: C1, not C1, half the spread, then compare them"
	@echo "make benchmarks measure error and run time against other libraries, into results/benchmarks"
	@echo "make integrator  build the wheel of the integrator, and run its tests, pages and benchmarks where nothing else is"
	@echo "make lint       run ruff, mypy, snakefmt and snakemake --lint"
	@echo "make format     reformat the files with ruff and snakefmt"
	@echo "make rules      write workflow/rules/line.smk, two tables and a picture from src/hopdata/stages.py"
	@echo "make docs       write docs/configuration.md from the schema, docs/constants.md from the code and docs/troubleshooting.md from the messages"
	@echo "make site       build the documentation into build/site; runs the tutorials and checks links"
	@echo "make sample     simulate the recordings of data/sample again"
	@echo "make lock       resolve requirements*.lock again (needs uv)"
	@echo "make release    build wheel and sdist reproducibly, test them in a fresh environment, write digests and release notes"
	@echo "make clean      remove .venv, the results of every study, and caches"

# The bundled study is run beside its control, and both are shown on one page. Snakemake tells of its progress only,
# and of each job that fails.
RUN := --cores $(CORES) --quiet host reason rules
figures: figures-told $(VENV)/.run
ifeq ($(CONFIG),config/config.yaml)
	$(BIN)/snakemake $(RUN) --snakefile workflow/first_look.smk --workflow-profile profiles/default
	@echo "Made. Open results/both_sides/first_look.html: the answer of both studies side by side."
	@echo "The whole of each: results/sample/report.html and results/sample_control/report.html"
else
	$(BIN)/snakemake $(RUN) --configfile $(CONFIG)
	@echo "Made. Open report.html in the study's folder in results."
endif

figures-told:
ifeq ($(CONFIG),config/config.yaml)
	@echo "Two studies of a simulated hopper, one with a C1 landing and one without, and a page that compares them."
	@echo "The first time about a minute on two free cores, besides what must be downloaded; then only what has changed."
else
	@echo "The study of $(CONFIG): only what has changed is made."
endif

# Parts that cannot be made are named at the end, and made again by the next run.
dissertation: $(VENV)/.dissertation
	$(BIN)/snakemake --cores $(CORES) dissertation
	@echo "open results/dissertation/index.html"

dissertation-docs: dissertation
	cp results/dissertation/dissertation.md docs/dissertation.md

test: $(VENV)/.dev
	$(BIN)/python -m pytest -n $(CORES) --dist loadfile --no-loadscope-reorder $(PYTEST_ARGS)

test-lowest:
	$(MAKE) test VENV=$(VENV)-lowest DEV_LOCK=requirements-lowest.lock

# Its storage plugin needs older versions than the other environments have.
test-cluster:
	$(MAKE) $(VENV)-cluster/.dev VENV=$(VENV)-cluster DEV_LOCK=requirements-cluster.lock
	VENV=$(VENV)-cluster tests/cluster.sh

# Guided by coverage; goes on with the inputs in build/fuzz, and puts what it finds into tests/fuzz/found.
MINUTES ?= 60
DOORS   ?=
fuzz: $(VENV)/.fuzz
	nice $(BIN)/python tests/fuzz/long_run.py --minutes $(MINUTES) --seed $(SEED) --cores $(CORES) --doors $(DOORS)

# As root it has a disk of its own to fill; otherwise the size of files is limited.
EVENTS ?= 1000
chaos: $(VENV)/.dev
	$(BIN)/python tests/chaos/chaos.py --events $(EVENTS) --seed $(SEED)

# ROOMS="verdict states" selects, EACH and SEED draw other changes; what was tried is not tried again.
ROOMS ?=
EACH  ?= 8
SEED  ?= 1
mutants: $(VENV)/.mutants
	$(BIN)/python tests/mutants.py run $(ROOMS) --each $(EACH) --seed $(SEED)

both-sides: $(VENV)/.run
	$(BIN)/snakemake --cores $(CORES) --configfile config/thesis.yaml
	$(BIN)/snakemake --cores $(CORES) --configfile config/control.yaml
	$(BIN)/snakemake --cores $(CORES) --configfile config/half_spread.yaml
	$(BIN)/snakemake --cores $(CORES) both_sides prediction_ratios

benchmarks: $(VENV)/.bench
	$(BIN)/snakemake --cores $(CORES) --keep-going benchmarks

integrator: $(VENV)/.dev
	$(BIN)/python packaging/hybrid/alone.py dist --cores $(CORES)

# `make -j 2 lint` runs mypy, which takes as long as the others, beside them.
lint: lint-types lint-style

lint-types: $(VENV)/.dev
	$(BIN)/mypy

lint-style: $(VENV)/.dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/snakefmt --check Snakefile workflow/rules $(wildcard src/hopdata/*/workflow/*.smk benchmarks/*/*.smk)
	$(BIN)/snakemake --lint

format: $(VENV)/.dev
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .
	$(BIN)/snakefmt Snakefile workflow/rules $(wildcard src/hopdata/*/workflow/*.smk benchmarks/*/*.smk)

rules: $(VENV)/.run
	$(BIN)/python packaging/rules.py

docs: $(VENV)/.run
	$(BIN)/hopdata config-docs --out docs/configuration.md
	$(BIN)/python benchmarks/constants.py page
	$(BIN)/python packaging/troubleshooting.py
	$(BIN)/python packaging/cannot_tell.py

site: $(VENV)/.docs
	rm -rf build/site
	$(BIN)/python docs/run_pages.py --jobs $(CORES)
	$(BIN)/sphinx-build --quiet --jobs $(CORES) --fail-on-warning --keep-going -c docs . build/site
	@echo "open build/site/index.html"

# Exact maps hold between sections, so the study of the new recording must find its sections first.
define bundle
	for step in simulated bundled; do \
	  $(BIN)/snakemake --cores 1 --configfile config/$(1).yaml -- results/$(2)/$$step/$(3).h5 && \
	  cp results/$(2)/$$step/$(3).h5 data/sample/ || exit 1; \
	done
endef

sample: $(VENV)/.run
	$(call bundle,config,sample,hopper)
	$(call bundle,sample_control,sample_control,control)

$(VENV)/pyvenv.cfg:
	@test -n "$(PYTHON)" || { echo "hopdata needs Python 3.11 or newer: none found on PATH (set PYTHON=...)" >&2; exit 1; }
	@if command -v uv >/dev/null 2>&1; then uv venv --quiet --clear --seed --python "$(PYTHON)" $(VENV); \
	else "$(PYTHON)" -m venv --clear $(VENV); fi

# One recipe for all environments; $(1) is the lock file. The locks agree on versions, so the environments share
# a folder. Build requirements are installed first, from a lock of their own, because an isolated build would
# fetch packages that no lock pins. A recent pip is among them: the one that Python brings may take twice as long
# to look through the index. Bytecode is not compiled at installation: a study imports few of the some
# 9,000 modules, and Python compiles those when they are imported.
define install
	@if command -v uv >/dev/null 2>&1; then \
	  pip="uv pip install --quiet --python $(BIN)/python"; \
	else \
	  pip="$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile"; \
	fi; \
	$$pip --require-hashes --only-binary :all: -r requirements-build.lock && \
	$$pip --require-hashes --no-build-isolation -r $(1) && \
	$$pip --no-deps --no-build-isolation -e .
	@touch $@
endef

$(VENV)/.run: requirements.lock requirements-build.lock pyproject.toml | $(VENV)/pyvenv.cfg
	@case "$(abspath $(VENV))" in *" "*) echo "VENV: expected a path without spaces (Snakemake cannot start a program from one with spaces)," \
	  "found $(abspath $(VENV)); keep it elsewhere, for example: make figures VENV=\$$HOME/.hopdata" >&2; exit 1;; esac
	@echo "Preparing $(VENV) from requirements.lock"
	$(call install,requirements.lock)

DEV_LOCK ?= requirements-dev.lock
$(VENV)/.dev: $(DEV_LOCK) requirements-build.lock pyproject.toml | $(VENV)/pyvenv.cfg
	@echo "Preparing $(VENV) from $(DEV_LOCK)"
	$(call install,$(DEV_LOCK))

# The simulator that the dissertation compares with, in addition to hopdata's own requirements.
$(VENV)/.dissertation: requirements-dissertation.lock | $(VENV)/.run
	$(call install,requirements-dissertation.lock)

# Sphinx and the packages that run the pages' code, in addition to hopdata's own requirements, which the environment of
# the tests has, too.
$(VENV)/.docs: requirements-docs.lock | $(if $(wildcard $(VENV)/.dev),,$(VENV)/.run)
	$(call install,requirements-docs.lock)

# The maker of wrong changes brings packages that nothing else needs.
$(VENV)/.mutants: requirements-mutants.lock | $(VENV)/.dev
	$(call install,requirements-mutants.lock)

# The fuzzer has wheels for Linux only.
$(VENV)/.fuzz: requirements-fuzz.lock | $(VENV)/.dev
	$(call install,requirements-fuzz.lock)

# The libraries that the benchmarks compare with are many and large, and nothing else needs them.
$(VENV)/.bench: requirements-bench.lock requirements-build.lock pyproject.toml | $(VENV)/pyvenv.cfg
	@echo "Preparing $(VENV) from requirements-bench.lock"
	$(call install,requirements-bench.lock)

LOCK := uv pip compile --universal --python-version 3.11 --generate-hashes --no-annotate --no-header --no-emit-index-url
lock:
	$(LOCK) pyproject.toml -o requirements.lock
	$(LOCK) pyproject.toml --extra test --extra lint -c requirements.lock -o requirements-dev.lock
	$(LOCK) pyproject.toml --extra test --resolution lowest-direct -o requirements-lowest.lock
	$(LOCK) pyproject.toml --extra test --extra cluster -o requirements-cluster.lock
	$(LOCK) pyproject.toml --extra mutants -c requirements-dev.lock -o requirements-mutants.lock
	$(LOCK) pyproject.toml --extra fuzz -c requirements-dev.lock -o requirements-fuzz.lock
	$(LOCK) pyproject.toml --extra bench -c requirements-dev.lock -o requirements-bench.lock
	$(LOCK) pyproject.toml --extra dissertation -c requirements-bench.lock -o requirements-dissertation.lock
	printf 'furo>=2024.8\ngymnasium>=1.0\nipykernel>=6.29\nlatex2mathml>=3.77\nmyst-nb>=1.2\nsphinx>=8.2\nxarray>=2024.7\n' | \
	  $(LOCK) - -c requirements-dev.lock -o requirements-docs.lock
# Installs quickly, and builds hopdata and Snakemake's dependency connection-pool, which is published only as source.
	printf 'hatchling>=1.27,<2\npip>=26\nsetuptools\n' | $(LOCK) - -c requirements-dev.lock -o requirements-build.lock

# Archives carry the commit's date, so that anyone can build the same bytes.
release: export SOURCE_DATE_EPOCH = $(shell git log -1 --format=%ct)
release: VERSION = $(shell $(BIN)/hopdata --version | cut -d' ' -f2)
release: $(VENV)/.dev
	@test -z "$$(git status --porcelain)" || { echo "release: expected a clean checkout, found changes" >&2; exit 1; }
	grep -q "^version: $(VERSION)$$" CITATION.cff
# The wheel contains machine code. It is removed from the checkout afterwards: a clone compiles its own.
	rm -rf dist && trap 'rm -rf src/hopdata/_machine_code' EXIT && \
	  $(BIN)/python packaging/machine_code.py src/hopdata/_machine_code && \
	  for to in dist dist/again; do $(BIN)/python -m hatchling build -d $$to || exit 1; done
	for file in dist/hopdata-*; do cmp $$file dist/again/$${file##*/} || exit 1; done
	$(BIN)/python packaging/hybrid/alone.py dist --cores $(CORES)
	rm -r dist/again && $(BIN)/python packaging/sbom.py dist/hopdata.cdx.json
	cd dist && sha256sum hopdata* > SHA256SUMS && cat SHA256SUMS
# The package index refuses invalid metadata. The changelog's entry becomes the text of the release.
	$(BIN)/python -c "import sys, tarfile; from packaging.metadata import Metadata; \
	  Metadata.from_email(tarfile.open(sys.argv[1]).extractfile('hopdata-$(VERSION)/PKG-INFO').read())" dist/*.tar.gz
	awk '/^## /{on = $$2 == "$(VERSION)"} on' CHANGELOG.md | sed "1s/(unreleased)/($$(git log -1 --format=%cs))/" \
	  > dist/CHANGES.md && test -s dist/CHANGES.md && head -n 1 dist/CHANGES.md
	for file in $(CURDIR)/dist/hopdata-*; do \
	  work=$$(mktemp -d) && (cd $$work && "$(PYTHON)" -m venv venv && \
	  venv/bin/pip install --quiet --require-hashes -r $(CURDIR)/requirements-build.lock && \
	  venv/bin/pip install --quiet --no-build-isolation --require-hashes -r $(CURDIR)/requirements.lock && \
	  venv/bin/pip install --quiet --no-build-isolation --no-deps $$file && venv/bin/pip check && \
	  venv/bin/hopdata run --cores $(CORES)) && rm -r $$work || exit 1; done

clean:
	find results -mindepth 1 -maxdepth 1 ! -name README.md -exec rm -rf {} +
	rm -rf build dist $(VENV) .snakemake .pytest_cache .mypy_cache .ruff_cache
