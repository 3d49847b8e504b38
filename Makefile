# Each target works on a fresh clone. `make` lists them.

TREE ?= monorepo
DISTRO ?= kilted
PYTHON ?= python3
VENV ?= .venv
ARGS ?=
TAG ?= 1
SIDE ?= 40
TREES := monorepo lupin_greenhouse_ros
ifeq ($(filter $(TREE),$(TREES)),)
$(error TREE=$(TREE) is no tree: TREE=monorepo or TREE=lupin_greenhouse_ros)
endif
ifeq ($(filter $(DISTRO),kilted jazzy),)
$(error DISTRO=$(DISTRO) has no wheels: DISTRO=kilted or DISTRO=jazzy)
endif
override VENV := $(if $(filter /%,$(VENV)),$(VENV),$(CURDIR)/$(VENV))
export TREE VENV
SHELL := bash
.SHELLFLAGS := -eo pipefail -c
MAKEFLAGS += --no-print-directory
IN_ENV := source ci/ros_env.bash &&

figure tags recall world world-check: override TREE := monorepo

.PHONY: help run smoke read mission world world-check tags env build generate generate-check drift test lint docs-check figure clean bench soak test-network recall test-heavy matrix test-apriltag test-22-04 mirror-publish mirror-publish-check mirror-import

help:  ## list the targets
	@sed -nE 's/^# (use|change|measure|publish)$$/\n\1:/p; s/^([a-z0-9-]+):.*## (.*)/  \1\t\2/p' $(MAKEFILE_LIST) | expand -t 24
	@echo; echo 'TREE=monorepo|lupin_greenhouse_ros, DISTRO=kilted|jazzy (without a sourced ROS), PYTHON, VENV'

# use

run: build  ## serve in the foreground: make run ARGS="debug_seed:=42 debug_time_of_day:=12.0"
	@$(IN_ENV) ci/serve $(ARGS)

smoke: build  ## start the bridge on a private domain and read every tag
	@$(IN_ENV) python ci/smoke.py

read: env  ## ask a running bridge: make read TAG=7, TAG="1 5", TAG=--all
	@$(IN_ENV) [ -x "$$LUPIN_EXECUTABLES/read_tag" ] || ci/build
	@$(IN_ENV) "$$LUPIN_EXECUTABLES/read_tag" $(TAG) $(ARGS)

mission: build  ## visit and read every tag: CAMERA=1 (compressed, detections) confirms each, WORLD=1 renders the world
	@$(if $(WORLD),ci/with_drake,$(if $(filter detections,$(CAMERA)),ci/with_stand_ins,$(IN_ENV))) \
	    python ci/mission.py $(if $(CAMERA),--camera $(CAMERA:1=image)) $(if $(WORLD),--world) $(ARGS)

world: build  ## an SDF world of the greenhouse in .world: ARGS="--tag-file F --side 0.05 --output DIR"
	@$(IN_ENV) "$$LUPIN_WORKSPACE/install/lupin_world/lib/lupin_world/generate_world" $(ARGS)

world-check: build  ## read and render that world with Drake: is each tag where the layout has it, and legible?
	@ci/with_drake python ci/world_check.py $(ARGS)

tags: build  ## a PDF of the tags to print, SIDE millimetres each: make tags SIDE=40
	@$(IN_ENV) python tools/draw/tag_sheet.py --side $(SIDE) $(ARGS)

# change

env:  ## make the Python environment (.venv) that all the others use
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 10))' 2>/dev/null \
	    || { echo 'environment: $(PYTHON) is not Python 3.10 or newer: sudo apt install python3, or make PYTHON=python3.12' >&2; exit 1; }
	@$(PYTHON) ci/environment.py --venv '$(VENV)' --distro $(DISTRO)

build: env  ## colcon build of TREE
	@ci/build

generate: env  ## write both trees from tools/core (ARGS=--prune: remove what a rename left)
	@$(IN_ENV) python tools/generate.py $(ARGS)

generate-check: env  ## check that both trees are what tools/core generates
	@$(IN_ENV) python tools/generate.py --check

drift:  ## check that the two trees differ in the one allowed line only
	@$(PYTHON) tools/check_drift.py --monorepo monorepo --mirror lupin_greenhouse_ros

test: env  ## all that CI checks of every change
	@$(IN_ENV) ci/test

lint: env  ## ruff: rules and format; the workflows against their schema
	@$(IN_ENV) ci/lint

docs-check: build  ## links, anchors and shell blocks of the documents
	@$(IN_ENV) python ci/docs_check.py

figure: build  ## draw the greenhouse into the documents: ARGS="--output . --tag-file F --sensor co2 --hour 6"
	@$(IN_ENV) python tools/draw/figure.py $(ARGS)
	@$(if $(ARGS),,$(IN_ENV) python tools/draw/seen.py)
	@$(if $(WORLD),ci/with_drake python tools/draw/world.py)

clean:  ## remove what was built (the environment stays: it is .venv)
	rm -rf '$(VENV)'*/workspace .pytest_cache .ruff_cache .hypothesis .mission .bench .tags .world

# measure

bench: build  ## the bridge against a bare rclpy node: one table and .bench/bench.json (SHORT=1: a look)
	@$(IN_ENV) python tools/measure/bench.py $(if $(SHORT),--short) $(ARGS)

soak: build  ## faults and load on this machine, with figures (SHORT=1, REFUSALS=12000, SIGNALS=500)
	@ci/with_stand_ins python tools/measure/soak.py $(if $(SHORT),--short) $(if $(REFUSALS),--refusals $(REFUSALS)) $(if $(SIGNALS),--signals $(SIGNALS)) $(ARGS)

test-network: build  ## two hosts as network namespaces: loss, delay, a pulled cable (needs root; SHORT=1)
	@$(IN_ENV) python tools/measure/network.py $(if $(SHORT),--short)

recall: build  ## how often the camera's detector finds a tag: by distance, angle, blur and noise
	@$(IN_ENV) python tools/measure/recall.py $(ARGS)

test-heavy: env  ## the measurements in their short forms, as CI runs them after make test
	@$(IN_ENV) ci/test_heavy

matrix:  ## the contract tests on every Python, distro and simulator to be had here
	@ci/matrix

test-apriltag: env  ## the detector's tests with apt's python3-apriltag (Debian 12, Ubuntu 22.04 and newer)
	@ci/test_apriltag

test-22-04: env  ## the mirror's tests with Python 3.10 and the versions of Ubuntu 22.04
	@ci/test_22_04

# publish

mirror-publish: env  ## push the mirror: REMOTE=URL [RELEASE=1.1.0] [ARGS=--dry-run]
	@$(IN_ENV) python tools/mirror_publish.py '$(REMOTE)' $(if $(RELEASE),--release $(RELEASE)) $(ARGS)

mirror-publish-check: env  ## split the mirror out of the last commit, clone it, follow its README
	@source ci/ros_env.bash without-overlay && python tools/mirror_publish_check.py

mirror-import: env  ## take a series of patches of the mirror into the core and both trees: PATCH=N.patch
	@$(IN_ENV) tools/mirror_import '$(PATCH)'
