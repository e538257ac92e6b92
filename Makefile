# Every target sets up what it needs: a virtual environment with pinned packages. `make help` lists the targets.

PYTHON ?= python3
VENV ?= .venv
SCALE ?= full
MODELS ?= train
JOBS ?=
ARGS ?=

# A misspelt variable would be ignored, and a run of minutes become one of hours.
VARIABLES := SCALE MODELS JOBS ARGS VENV PYTHON
$(foreach _each,$(.VARIABLES),$(if $(filter command,$(firstword $(origin $(_each)))),$(if $(filter-out SHELL $(VARIABLES),$(_each)),\
$(error $(_each) is not a variable of this Makefile; there are: $(VARIABLES). Keys of the configuration go into ARGS, as in ARGS='members=2'))))

BIN := $(VENV)/bin
READY := $(VENV)/.ready
TOOLS := $(VENV)/.ready-tools
SETTINGS = scale=$(SCALE) models=$(MODELS) $(if $(JOBS),hydra.launcher.n_jobs=$(JOBS)) $(ARGS)

EXPERIMENTS := $(patsubst affmap/experiments/%/claims.py,%,$(sort $(wildcard affmap/experiments/*/claims.py)))
PAPER := $(shell grep -ls '^  paper_figures:' $(EXPERIMENTS:%=conf/experiment/%.yaml) | sed -E 's,.*/(.*)\.yaml,\1,')
BEYOND := $(filter-out $(PAPER),$(EXPERIMENTS))
FACTORS := $(patsubst conf/experiment/%.yaml,%,$(sort $(wildcard conf/experiment/factors/*.yaml)))
REPLICATIONS := $(filter-out %_growth,$(patsubst conf/experiment/%.yaml,%,$(sort $(wildcard conf/experiment/replication/*.yaml))))
SEARCHES := training cem gradient

.DEFAULT_GOAL := help
.PHONY: help setup $(EXPERIMENTS) lookups factors $(FACTORS) replication $(REPLICATIONS) tune paper beyond publish play bench gpu docs test slow check format clean

help:  ## list the targets
	@{ $(foreach name,$(EXPERIMENTS),sed -n 's/^title: "\(.*\)"/$(name):  ## \1/p' conf/experiment/$(name).yaml;) \
	grep -hE '^[a-z0-9-]+:.*## ' $(MAKEFILE_LIST); } | sed -E 's/^([a-z0-9_-]+):.*## /  \1|/' | column -t -s '|'
	@echo "Settings: SCALE=full|smoke MODELS=train|reference JOBS=<jobs at once; default: one a core> ARGS='<Hydra overrides>'"
	@echo "          VENV=<folder> PYTHON=<interpreter, 3.11 to 3.13>"

setup: $(READY)  ## create the virtual environment, with what experiments need

$(TOOLS): $(READY)
$(READY): CONTENT := affmap, PyTorch and the packages they need
$(READY): EXTRAS := [rl]
$(TOOLS): CONTENT := tools for tests, checks and documentation
$(TOOLS): EXTRAS := [dev,docs]
$(VENV)-bench/.ready: CONTENT := affmap and the libraries that it is timed beside
$(VENV)-bench/.ready: MORE := --no-deps --requirement tests/benchmarks/requirements.txt
$(VENV)-bench/.ready: tests/benchmarks/requirements.txt
$(VENV)-slow/.ready: CONTENT := affmap, launchers of clusters, loggers, Optuna and Stable-Baselines3
$(VENV)-slow/.ready: EXTRAS := [dev,mlflow,optuna,ray,rl,slurm,trackio,wandb]
# Ray's launcher and Trackio want older versions of these, which no number depends on.
$(VENV)-slow/.ready: UNPINNED := cloudpickle|joblib|pillow|python-dateutil

# An environment that is made here has the mark .ours, and .unfinished, with the number of make's process, while packages
# are installed into it: after an interruption it is made anew (pip caches). One of the user's own is completed and never removed.
# torch first and pinned: asked for later, a larger build of it may be chosen. The constraints hold for builds, too.
$(READY) $(TOOLS) $(VENV)-bench/.ready $(VENV)-slow/.ready: pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(not (3, 11) <= sys.version_info < (3, 14) and "affmap needs Python 3.11 to 3.13: make PYTHON=...")'
	@! kill -0 "$$(cat $(@D)/.unfinished 2> /dev/null)" 2> /dev/null || { echo "Another make is installing into $(@D); run this when it has finished." >&2; exit 1; }
	@echo "Installing into $(@D): $(CONTENT). This takes some minutes, once."
	@test ! -e $(@D)/.unfinished || find $(@D) -mindepth 1 ! -path $(@D)/.ours ! -path $(@D)/.unfinished -delete
	@test -e $(@D) || { mkdir -p $(@D) && touch $(@D)/.ours; }
	@test ! -e $(@D)/.ours || echo $$PPID > $(@D)/.unfinished
	@rm -f $(@D)/.ready
	@$(@D)/bin/python -m pip --version > /dev/null 2>&1 || $(PYTHON) -m venv $(@D)
	@grep -vE '^($(UNPINNED))==' constraints.txt > $(@D)/constraints.txt
	@export PIP_CONSTRAINT=$(@D)/constraints.txt PIP_BUILD_CONSTRAINT=$(@D)/constraints.txt PIP_DISABLE_PIP_VERSION_CHECK=1 && \
	$(@D)/bin/python -m pip install --quiet torch && \
	$(@D)/bin/python -m pip install --quiet --editable '.$(EXTRAS)' $(if $(MORE),&& $(@D)/bin/python -m pip install --quiet $(MORE))
	@rm -f $(@D)/.unfinished
	@touch $(@D)/.ready $@

lookups:  ## control with the affordance map and with exact look-ups compared (a few minutes; after exp1)
factors: $(FACTORS)  ## one factor at a time: what decides the claims that do not hold? (half an hour; after paper)
replication: $(REPLICATIONS)  ## Experiments I, III and V with 100 fresh members: are open claims decided by more of them? (two hours)
$(EXPERIMENTS) lookups $(FACTORS) $(REPLICATIONS): $(READY)
	$(BIN)/affmap experiment=$@ $(SETTINGS)
	$(BIN)/affmap-report experiment=$@ $(SETTINGS)

paper: $(PAPER)  ## the paper's experiments, what is missing of them, and one report of all: runs/paper/report.pdf
	$(BIN)/affmap-paper $(SETTINGS)

beyond: $(BEYOND)  ## experiments VI to X, beyond the paper, and a report of all: runs/beyond/report.pdf (four hours)
	$(BIN)/affmap-paper --beyond $(SETTINGS)

tune: $(READY)  ## are the paper's learning rates and planners near the best? Three searches of 60 trials (minutes)
	for name in $(SEARCHES); do $(BIN)/affmap search=$$name $(SETTINGS) && $(BIN)/affmap-report search=$$name $(SETTINGS) || exit 1; done

publish: paper beyond lookups factors replication  ## keep the reports and models of all experiments in runs/reference
	for name in $(EXPERIMENTS) lookups $(FACTORS); do $(BIN)/affmap-publish experiment=$$name $(SETTINGS) || exit 1; done
	for name in $(REPLICATIONS); do $(BIN)/affmap-publish experiment=$$name $(SETTINGS) --report-only || exit 1; done
	for flag in "" --beyond; do $(BIN)/affmap-paper $$flag --publish $(SETTINGS) || exit 1; done

play: $(READY)  ## a window in which to fly, or watch a trained agent imagine and fly
	$(BIN)/affmap-play $(ARGS)

bench: $(VENV)-bench/.ready  ## speed beside other libraries, in an environment of their own (about 5 minutes)
	$(VENV)-bench/bin/python -W ignore tests/benchmarks $(ARGS)

gpu: $(READY)  ## an NVIDIA card beside the CPU: the same results, and speed (a few minutes; needs torch built for CUDA)
	$(BIN)/python -W ignore tests/benchmarks/gpu.py $(ARGS)

docs: $(TOOLS)  ## build the documentation: build/site/index.html
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -W ignore -m mkdocs build --strict --quiet
	@echo "The documentation is build/site/index.html"

test: $(TOOLS)  ## run the tests, a process on each core
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest --numprocesses logical --maxprocesses 8 --dist loadfile $(ARGS)

slow: $(VENV)-slow/.ready  ## run sweeps through launchers of clusters, loggers and Optuna; train PPO
	$(VENV)-slow/bin/python -m pytest -m slow

check: $(TOOLS)  ## lint, format, types, import graph; files of the published run against their digests
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/affmap-publish --check

format: $(TOOLS)  ## format the code
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

clean:  ## remove virtual environments, caches and the documentation's site (what runs wrote stays)
	rm -rf $(VENV) $(VENV)-bench $(VENV)-slow .pytest_cache .hypothesis .mypy_cache .ruff_cache .import_linter_cache build/site
