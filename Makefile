# Each target works in a fresh clone. `make` lists them.

TREE ?= monorepo
DISTRO ?= $(if $(shell command -v ros2),$(ROS_DISTRO),kilted)
PYTHON ?= python3
# The Python of Ubuntu 22.04, for `make test-heavy`.
PYTHON3_10 ?= $(or $(lastword $(wildcard ~/.pyenv/versions/3.10.*/bin/python)),python3.10)
VENV ?= .venv
# What is installed over the pinned packages, such as mdp-greenhouse==1.0.7.
WITH ?=
TAG ?= 1
SIDE ?= 40
override VENV := $(abspath $(VENV))
export TREE VENV
export MPLBACKEND := Agg
SHELL := bash
.SHELLFLAGS := -eo pipefail -c
MAKEFLAGS += --no-print-directory
# For $$* in a list of prerequisites: the stem of the target.
.SECONDEXPANSION:

ENV := $(VENV)/.made-$(DISTRO)
BUILT := $(VENV)/workspace/$(TREE)/built
MONOREPO := $(VENV)/workspace/monorepo/built
MIRROR := $(VENV)/workspace/lupin_greenhouse_ros/built
STAND_INS := $(VENV)/workspace/ci/stand_ins/built
IN_ENV := source ci/ros_env.bash &&
# For what needs no package of ours, and may run while one is built.
BARE := source ci/ros_env.bash without-overlay &&
# What tests import from beside them; it depends on TREE. The plugins that colcon brings do not fit an old pytest.
TEST_PATH = $(subst $() ,:,$(abspath $(wildcard $(TREE)/*/test) ci ci/tests tools tools/tests tools/draw tools/measure))
# A hang fails. Tests often wait, so three workers do for two cores.
PYTEST = PYTHONPATH=$(TEST_PATH):$$PYTHONPATH PYTEST_DISABLE_PLUGIN_AUTOLOAD=1 timeout --kill-after=30 25m \
    python -m pytest -c .pytest.ini -p xdist -n 3 --import-mode=importlib -p no:cacheprovider
TESTS := $(wildcard monorepo/*/test) ci/tests $(wildcard tools/*tests tools/*/tests)
NEWEST_REPORT := $(or $(shell ls -t .mission/*.jsonl 2>/dev/null | head -n 1),.mission)

# What these run is in the monorepo, whatever TREE says.
bench docs-check figure mission page soak tags test-heavy test-monorepo world: override TREE := monorepo

help:  ## list the targets
	@sed -nE 's/^# (use|change|measure|publish)$$/\n\1:/p; s/^([a-z-]+):.*## (.*)/  \1\t\2/p' Makefile | expand -t 18
	@echo; echo 'Variables: TREE=monorepo|lupin_greenhouse_ros, DISTRO=kilted|jazzy, PYTHON=python3.12, VENV=folder'

# use

run: $(BUILT)  ## run the bridge until Ctrl-C: make run ARGS="debug_seed:=42 debug_time_of_day:=12.0"
	@$(IN_ENV) exec ci/serve $(ARGS)

smoke: $(BUILT)  ## start the bridge on a private domain and read every tag
	@$(IN_ENV) python ci/smoke.py

read: $(BUILT)  ## read tags from a running bridge: make read TAG=7, TAG="1 5", TAG=--all
	@$(IN_ENV) read_tag $(TAG) $(ARGS)

mission: $(MONOREPO) $(STAND_INS)  ## visit and read every tag: CAMERA=1 looks for each, DRIVE=1 drives there, RECORD=FILE keeps the readings
	@$(IN_ENV) inspection --output .mission $(if $(CAMERA),--camera) $(if $(DRIVE),--drive) \
	    $(if $(RECORD),--record "$(RECORD)") $(ARGS)

page: $(MONOREPO)  ## make a page of the readings of the last mission, or of FILE=readings.sqlite
	@$(IN_ENV) readings_page "$(or $(FILE),$(NEWEST_REPORT))" $(ARGS)

world: $(MONOREPO)  ## make an SDF world of the greenhouse in .world: ARGS="--tag-file F --side 0.05"
	@$(IN_ENV) generate_world $(ARGS)

tags: $(MONOREPO)  ## make a PDF of the tags to print, SIDE millimetres wide: make tags SIDE=40
	@$(IN_ENV) python tools/draw/tag_sheet.py --side $(SIDE) $(ARGS)

# change

env: $(ENV)  ## make the environment .venv
$(ENV): ci/environment.py $(wildcard ci/requirements/*.txt)
	@flock $(VENV).lock $(PYTHON) ci/environment.py $(VENV) $(DISTRO) $(WITH)
	@touch $@

build: $(BUILT)  ## build TREE with colcon
# The stem is a folder of packages, which are named one by one, because the COLCON_IGNORE in the mirror hides its root.
# The Python packages are built anew, because colcon would keep a module that was deleted. Stand-ins are left out where
# ROS has the package. Messages leave out C++, which takes most of the time.
$(VENV)/workspace/%/built: $(ENV) $$(shell find $$* -not -name __pycache__ -not -name '*.pyc')
	@mkdir -p $(@D) && exec 9>$(@D).lock && flock 9 && $(BARE) export MAKEFLAGS=-j$$(nproc) && \
	    rm -rf $(filter-out %_msgs,$(wildcard $(@D)/build/lupin_* $(@D)/install/lupin_*)) && \
	    in_ros=$$(python -c 'import importlib.util as u; print(*filter(u.find_spec, ["apriltag_msgs", "nav2_msgs"]))') && \
	    python -m colcon --log-base $(@D)/log build --build-base $(@D)/build --install-base $(@D)/install \
	    --packages-skip $$in_ros --paths $(patsubst %/package.xml,%,$(wildcard $*/*/package.xml)) \
	    --cmake-args -DPython3_EXECUTABLE=$(VENV)/bin/python -DBUILD_TESTING=OFF -DWITH_CPP=OFF --no-warn-unused-cli
	@touch $@

generate: $(ENV)  ## write both trees from tools/core (ARGS=--force drops an edit)
	@$(BARE) python tools/generate.py $(ARGS)

generate-check: $(ENV)  ## check that both trees are what tools/core generates
	@$(BARE) python tools/generate.py --check

drift:  ## check that the two trees differ in the one allowed line only
	@$(PYTHON) tools/check_drift.py --monorepo monorepo --mirror lupin_greenhouse_ros

lint: $(ENV)  ## check the code with ruff, mypy and deno, the spelling, and the workflows against their schema
	@$(BARE) ruff check . && ruff format --check .
	@$(BARE) deno lint --quiet --rules-include=eqeqeq $$(git ls-files 'monorepo/lupin_readings/*.js')
	@$(BARE) mypy
	@$(BARE) git ls-files -z ':!*.png' ':!ci/requirements' | xargs -0 codespell
	@$(BARE) check-jsonschema --builtin-schema vendor.github-workflows $$(git ls-files '*.github/workflows/*.yml')

docs-check: $(MONOREPO)  ## check the links and the tables of parameters in the documents
	@$(IN_ENV) python ci/docs_check.py

test:  ## check the code and the documents, build both trees, and run the tests of the monorepo and of the mirror
	@$(MAKE) -j4 lint generate-check drift $(MONOREPO) $(MIRROR) $(STAND_INS)
	@$(MAKE) docs-check test-monorepo
	@$(MAKE) test-mirror

# A test compares the messages of both trees on the wire, so it needs the mirror's too.
IN_BOTH := $(IN_ENV) source $(MIRROR:built=install)/lupin_greenhouse_msgs/share/lupin_greenhouse_msgs/package.bash &&
test-monorepo: $(MONOREPO) $(MIRROR) $(STAND_INS)
	@$(IN_BOTH) $(PYTEST) -m 'not heavy' $(TESTS)

test-mirror: override TREE := lupin_greenhouse_ros
test-mirror: $(MIRROR) $(STAND_INS)
	@$(IN_ENV) $(PYTEST) $(wildcard lupin_greenhouse_ros/*/test)

test-heavy: $(MONOREPO) $(MIRROR) $(STAND_INS)  ## run what takes minutes, in other environments too
	@$(IN_BOTH) $(PYTEST) -m heavy $(TESTS)
	@$(MAKE) test-mirror VENV=$(VENV)-jazzy DISTRO=jazzy WITH=mdp-greenhouse==1.0.7
	@# The first of WITH replaces the newer OpenCV, over whose files the second would write its own.
	@$(MAKE) test-monorepo VENV=$(VENV)-oldest PYTHON=$(PYTHON3_10) \
	    WITH='opencv-python-headless==4.5.4.60 ci/requirements/ubuntu_22_04.txt' TESTS='$(wildcard monorepo/*/test)'

figure: $(MONOREPO)  ## draw the annotated greenhouse of the documents: ARGS="--output FOLDER"
	@$(IN_ENV) python tools/draw/figure.py $(ARGS)

clean:  ## remove what was built, but not the environment
	rm -rf $(VENV)/workspace .mypy_cache .pytest_cache .ruff_cache .hypothesis

lock:  ## pin every wheel of ci/requirements/*.in, direct and transitive (needs uv)
	@cd ci/requirements && for distro in kilted jazzy; do \
	    uv pip compile --quiet --upgrade --universal --python-version 3.10 --annotation-style line \
	        --custom-compile-command 'make lock' $$distro.in --output-file $$distro.txt; done

# measure

bench: $(MONOREPO)  ## compare the bridge with a plain wrapper of the simulator (SHORT=1: half a minute)
	@$(IN_ENV) python tools/measure/bench.py $(if $(SHORT),--short)

soak: $(MONOREPO)  ## check the promises under faults and load (SHORT=1: half a minute)
	@$(IN_ENV) python tools/measure/soak.py $(if $(SHORT),--short)

# publish

mirror-publish: $(ENV)  ## push the mirror: REMOTE=URL [RELEASE=3.0.0] [ARGS=--dry-run]
	@$(IN_ENV) python tools/mirror_publish.py $(REMOTE) $(if $(RELEASE),--release $(RELEASE)) $(ARGS)

mirror-import: $(ENV)  ## import a patch of the mirror into the core and both trees: PATCH=N.patch
	@$(IN_ENV) python tools/mirror_import.py "$(PATCH)"

.PHONY: $(shell sed -nE 's/^([a-z-]+):.*/\1/p' Makefile)
