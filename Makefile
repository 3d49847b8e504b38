# Each target works in a fresh clone. `make` lists them.

COMMON := TREE DISTRO PYTHON VENV CC CXX
TREE ?= monorepo
DISTRO ?= kilted
PYTHON ?= python3
override VENV := $(or $(VENV),.venv)
TREES := monorepo lupin_greenhouse_ros
TARGETS := help run smoke read mission page world tags \
    env build bridge generate generate-check drift test test-tree lint docs-check figure clean lock \
    bench soak test-heavy matrix test-apriltag test-22-04 \
    mirror-publish mirror-publish-check mirror-import
# The variables that a target takes beside COMMON.
TAKES_run := NAMESPACE ARGS
TAKES_read := TAG NAMESPACE ARGS
TAKES_mission := CAMERA DRIVE RECORD ARGS
TAKES_page := FILE ARGS
TAKES_world := ARGS
TAKES_tags := SIDE ARGS
TAKES_build := PACKAGES
TAKES_generate := ARGS
TAKES_test := WORKERS
TAKES_test-tree := PACKAGES WORKERS
TAKES_figure := ARGS
TAKES_bench := SHORT
TAKES_soak := SHORT
TAKES_matrix := PYTHONS DISTROS SIMULATORS WORKERS
TAKES_mirror-publish := REMOTE RELEASE ARGS
TAKES_mirror-import := PATCH
# The variable of a value that a person writes as a target.
VALUE_read := TAG
VALUE_mission := RECORD
VALUE_page := FILE
VALUE_tags := SIDE
VALUE_mirror-import := PATCH
SWITCHES := CAMERA DRIVE SHORT
ON := 1 yes Yes YES on On ON true True TRUE
OFF := 0 no No NO off Off OFF false False FALSE
CAMERAS := image compressed detections
COMMA := ,
# What a person writes reaches a shell in quotes, and make expands no $ in it.
QUOTED = '$(subst ','\'',$(1))'

# A typing mistake costs one line before anything is built.
GOALS := $(or $(MAKECMDGOALS),help)
WRONG := $(filter-out $(TARGETS),$(GOALS))
ifneq ($(WRONG),)
NAMED := $(firstword $(filter $(COMMON) $(foreach target,$(TARGETS),$(TAKES_$(target))),$(WRONG)))
# DRIVE CAMERA are two of them; TAG 1 is one, and its value.
REST := $(filter-out $(NAMED) $(SWITCHES),$(WRONG))
NEAREST := import difflib, sys; print(*difflib.get_close_matches(sys.argv[1].lower(), sys.argv[2:], 1, 0.6))
# A word with a dot is a file.
NEAREST := $(if $(findstring .,$(WRONG)),,$(shell python3 -ESc '$(NEAREST)' $(call QUOTED,$(firstword $(WRONG))) $(TARGETS)))
MEANT := $(firstword $(foreach goal,$(GOALS),$(VALUE_$(goal))))
HINT := $(or \
    $(if $(word 2,$(filter $(SWITCHES),$(WRONG))),write $(WRONG:%=%=1)),\
    $(if $(NAMED),write $(NAMED)=$(or $(if $(word 2,$(REST)),"$(REST)",$(REST)),$(if $(filter $(SWITCHES),$(NAMED)),1,VALUE))),\
    $(if $(NEAREST),did you mean $(NEAREST)?),\
    $(if $(filter-out TAG SIDE,$(or $(MEANT),none)),$(if $(filter 0 1,$(WRONG)),write a value without a space$(COMMA) such as DRIVE=1)),\
    $(if $(MEANT),write $(MEANT)="$(strip $(if $(filter TAG FILE,$(MEANT)),$($(MEANT))) $(WRONG))"),\
    the targets are $(TARGETS))
$(error there is no target $(WRONG): $(HINT))
endif
TAKEN := $(sort $(foreach goal,$(GOALS),$(TAKES_$(goal))))
GIVEN := $(foreach name,$(.VARIABLES),$(if $(findstring command line,$(origin $(name))),$(name)))
REFUSED := $(filter-out $(COMMON) $(TAKEN),$(GIVEN))
ifneq ($(REFUSED),)
TAKERS := $(strip $(foreach target,$(TARGETS),$(if $(filter $(REFUSED),$(TAKES_$(target))),$(target))))
HINT := $(or \
    $(if $(TAKERS),; $(REFUSED) is of make $(TAKERS)),\
    $(if $(filter ROS_% RMW_%,$(REFUSED)),; write $(firstword $(REFUSED))=... before make),\
    $(if $(filter run mission,$(GOALS)),; set a parameter with ARGS="name:=value"))
$(error make $(GOALS) takes no $(REFUSED): it takes $(strip $(TAKEN) $(COMMON))$(HINT))
endif
$(foreach name,$(TAKEN) TREE DISTRO PYTHON VENV,$(if $(value $(name)),$(eval override $(name) := $$(value $(name)))$(eval export $(name))))
ifneq ($(words $(TREE))$(filter-out $(TREES),$(TREE)),1)
$(error TREE=$(TREE) is not a tree: set TREE=monorepo or TREE=lupin_greenhouse_ros)
endif
ifneq ($(words $(DISTRO))$(filter-out kilted jazzy,$(DISTRO)),1)
$(error DISTRO=$(DISTRO) has no wheels: set DISTRO=kilted or DISTRO=jazzy)
endif
$(foreach name,$(filter $(SWITCHES),$(TAKEN)),$(if $(word 2,$($(name)))$(filter-out $(ON) $(OFF) $(if $(filter CAMERA,$(name)),$(CAMERAS)),$($(name))),\
    $(error $(name)=$($(name)): write $(name)=1 or $(name)=0$(if $(filter CAMERA,$(name)),$(COMMA) CAMERA=compressed or CAMERA=detections))))
# DRIVE=0 is off, as DRIVE= is, and DRIVE=yes is DRIVE=1.
$(foreach name,$(SWITCHES),$(eval override $(name) := $(if $(filter $(ON),$($(name))),1,$(filter-out $(OFF),$($(name))))))
override VENV := $(if $(filter /%,$(VENV)),$(VENV),$(CURDIR)/$(VENV))
export TREE VENV SIDE
# Pictures are written to files. A comment on the same line would put spaces into the value.
export MPLBACKEND := Agg
TAG ?= 1
# TAG=1,5 and TAG=all are what a person may write, too.
override TAG := $(foreach tag,$(patsubst all,--all,$(subst $(COMMA), ,$(TAG))),$(call QUOTED,$(tag)))
# The root has no name: team7/ is /team7, and / is empty.
override NAMESPACE := $(if $(word 2,$(NAMESPACE)),$(NAMESPACE),$(addprefix /,$(patsubst /%,%,$(patsubst %/,%,$(NAMESPACE)))))
SIDE := $(or $(SIDE),40)
SHELL := bash
.SHELLFLAGS := -eo pipefail -c
MAKEFLAGS += --no-print-directory
# ARGS becomes the words that a shell makes of it, but nothing in it is run.
SPLIT := import os, shlex, sys; print(shlex.join(map(os.path.expanduser, shlex.split(sys.argv[1]))))
ifdef ARGS
override ARGS := $(shell $(call QUOTED,$(PYTHON)) -ESc $(call QUOTED,$(SPLIT)) $(call QUOTED,$(ARGS)) 2>/dev/null)
ifeq ($(.SHELLSTATUS),1)
$(error ARGS has a quote without its pair: write ARGS='name:="a value" --option value')
endif
endif
IN_ENV := source ci/ros_env.bash &&
# Of a package that is built: $(call EXECUTABLE,package,name)
EXECUTABLE = "$$LUPIN_WORKSPACE/install/$(1)/lib/$(1)/$(2)"
# Ctrl-C ends all that it has started.
KILL_TREE := python ci/kill_tree.py
RUN_TESTS := $(IN_ENV) $(KILL_TREE) python ci/run_tests.py
# These start with every `make run`: -ES, because the environment's own modules take 0.1 s to find.
QUICK_PYTHON := $(call QUOTED,$(PYTHON)) -ES
BUILD := "$$VENV/bin/python" -ES ci/build.py
WITHIN := "$$VENV/bin/python" -ES ci/within.py

# Their programs use packages that only the monorepo has, whatever TREE says.
bench docs-check figure soak tags world: override TREE := monorepo

.PHONY: $(TARGETS) page-check mission-check namespace-check python-check run-check tags-check

help:  ## list the targets
	@sed -nE 's/^# (use|change|measure|publish)$$/\n\1:/p; s/^([a-z0-9-]+):.*## (.*)/  \1\t\2/p' $(MAKEFILE_LIST) | expand -t 24
	@echo; echo 'TREE=monorepo|lupin_greenhouse_ros, DISTRO=kilted|jazzy (without a sourced ROS), PYTHON, VENV; $(SWITCHES): 1 or yes, 0 or no'

# use

run: run-check namespace-check bridge  ## run the bridge in the foreground: make run ARGS="debug_seed:=42 debug_time_of_day:=12.0"
	@$(IN_ENV) ci/serve $(if $(NAMESPACE),$(call QUOTED,namespace:=$(NAMESPACE))) $(ARGS)

run-check: python-check
	@$(if $(ARGS),$(QUICK_PYTHON) ci/check_run.py $(ARGS))

namespace-check:
	@[[ ! "$$NAMESPACE" || "$$NAMESPACE" =~ ^(/[A-Za-z_][A-Za-z0-9_]*)+$$ ]] \
	    || { echo "NAMESPACE='$$NAMESPACE' is none: write letters, digits and _, such as NAMESPACE=/team7" >&2; exit 2; }

smoke: bridge  ## start the bridge on a private domain and read every tag
	@$(IN_ENV) python ci/smoke.py

read: namespace-check bridge  ## read tags from a running bridge (default: tag 1): make read TAG=7, TAG="1 5", TAG=--all, NAMESPACE=/team7
	@$(IN_ENV) "$$LUPIN_EXECUTABLES/read_tag" $(TAG) $(if $(NAMESPACE),--service $(call QUOTED,$(NAMESPACE)/greenhouse_bridge/get_tag_reading)) $(ARGS)

mission: IN_MISSION = $(addprefix $(WITHIN) ,$(if $(DRIVE)$(filter detections,$(CAMERA)),--stand-ins))
mission: INSPECTION = $(call EXECUTABLE,lupin_simulation,inspection) --output '$(CURDIR)/.mission' $(if $(CAMERA),--camera $(CAMERA:1=image)) \
    $(if $(DRIVE),--drive) $(if $(RECORD),--record "$$RECORD") $(ARGS)
mission: mission-check $(if $(filter monorepo,$(TREE)),build)  ## visit and read every tag; CAMERA=1 (compressed, detections) confirms each, DRIVE=1 drives a robot there, RECORD=FILE keeps the readings
	@$(if $(IN_MISSION),$(IN_ENV) $(INSPECTION) --check)
	@$(IN_ENV) $(IN_MISSION) $(INSPECTION)

mission-check:
	@[ $(TREE) = monorepo ] || { echo 'mission: it is in the monorepo only: make mission TREE=monorepo' >&2; exit 2; }
	@[[ ! "$$RECORD" || "$${RECORD,,}" =~ \.(sqlite|db|csv)$$ ]] \
	    || { echo "mission: RECORD='$$RECORD' ends in none of .sqlite, .db, .csv: write RECORD=readings.sqlite" >&2; exit 2; }
	@folder=$$(dirname "$$RECORD"); [ -d "$$folder" ] \
	    || { echo "mission: RECORD='$$RECORD': there is no folder '$$folder': make it (mkdir -p), or name another" >&2; exit 2; }; \
	[ -w "$$folder" ] || { echo "mission: RECORD='$$RECORD': you cannot write to the folder '$$folder': name another" >&2; exit 2; }

page: export READINGS = $(or $(FILE),$(shell find .mission -name '*.jsonl' -size +0 -printf '%T@ %p\n' 2>/dev/null | sort -n | tail -1 | cut -d' ' -f2-))
page: page-check bridge  ## make a page of the readings of the last mission, or of FILE=readings.sqlite
	@$(IN_ENV) "$$LUPIN_EXECUTABLES/readings_page" "$$READINGS" $(ARGS)

page-check:
	@[ "$$READINGS" ] || { echo 'page: .mission holds no report: make mission, or make page FILE=readings.sqlite' >&2; exit 2; }
	@$(if $(FILE),,echo "page: of the newest report, $$READINGS")

world: build  ## make an SDF world of the greenhouse in .world: ARGS="--tag-file F --side 0.05 --output DIR"
	@$(IN_ENV) $(call EXECUTABLE,lupin_simulation,generate_world) $(ARGS)

tags: tags-check build  ## make a PDF of the tags to print, SIDE millimetres each: make tags SIDE=40
	@$(IN_ENV) python tools/draw/tag_sheet.py --side $(call QUOTED,$(SIDE)) $(ARGS)

tags-check:
	@[[ "$$SIDE" =~ ^[0-9]+([.][0-9]*)?$$ ]] && awk -v side="$$SIDE" 'BEGIN { exit !(8 <= side && side <= 152) }' \
	    || { echo "tags: SIDE='$$SIDE' is no number of millimetres between 8 and 152: write SIDE=40" >&2; exit 2; }

# change

python-check:
	@$(QUICK_PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 10))' 2>/dev/null \
	    || { echo 'environment: $(subst ','\'',$(PYTHON)) is not Python 3.10 or newer: sudo apt install python3, or make $(or $(MAKECMDGOALS),run) PYTHON=python3.12' >&2; exit 1; }

env: python-check  ## make the Python environment (.venv) of all targets
	@$(QUICK_PYTHON) ci/environment.py "$$VENV" $(DISTRO)

build: env  ## build TREE with colcon
	@$(BUILD) $$PACKAGES

bridge: env  ## build the bridge and its messages
	@$(BUILD) $(TREE)/lupin_*msgs $(TREE)/lupin_greenhouse_bridge

generate: env  ## write both trees from tools/core (ARGS=--prune: remove what a rename left)
	@$(IN_ENV) python tools/generate.py $(ARGS)

generate-check: env  ## check that both trees are what tools/core generates
	@$(IN_ENV) python tools/generate.py --check

drift:  ## check that the two trees differ in the one allowed line only
	@$(call QUOTED,$(PYTHON)) tools/check_drift.py --monorepo monorepo --mirror lupin_greenhouse_ros

test: env  ## check the code, both trees and all packages
	@$(RUN_TESTS) all

test-tree: env  ## run the tests of the packages of TREE: make test-tree PACKAGES=monorepo/lupin_mission WORKERS=4
	@$(RUN_TESTS) tree

lint: env  ## check the code with ruff and mypy, the spelling, and the workflows against their schema
	@$(IN_ENV) ruff check . && ruff format --check . || { echo 'lint: ruff format . wraps lines, in a shell with ci/ros_env.bash' >&2; exit 1; }
	@$(IN_ENV) deno lint --quiet --rules-include=eqeqeq $$(git ls-files 'tools/*.js')
	@! git grep -nE '.{121}' -- 'tools/*.js' || { echo 'lint: a line of a script is longer than 120 characters: wrap it' >&2; exit 1; }
	@$(IN_ENV) mypy
	@$(IN_ENV) git ls-files -z ':!*.png' ':!ci/requirements' | xargs -0 codespell
	@$(IN_ENV) check-jsonschema --builtin-schema vendor.github-workflows $(wildcard .github/workflows/*.yml lupin_greenhouse_ros/.github/workflows/*.yml)

docs-check: build  ## check links, shell blocks, parameters, ROS graphs and files of tests in the documents
	@$(IN_ENV) $(WITHIN) --stand-ins python ci/docs_check.py

figure: build  ## draw the greenhouse for the documents: ARGS="--output FOLDER"
	@$(IN_ENV) python tools/draw/figure.py $(ARGS)

clean:  ## remove what was built (not the environment .venv, and not .mission, .tags and .world)
	rm -rf "$$VENV"*/workspace .mypy_cache .pytest_cache .ruff_cache .hypothesis

lock:  ## pin every wheel of ci/requirements/*.in, direct and transitive, for Python 3.10 and newer (needs uv)
	@cd ci/requirements && for distro in kilted jazzy; do \
	    uv pip compile --quiet --upgrade --universal --python-version 3.10 --annotation-style line \
	        --custom-compile-command 'make lock' $$distro.in --output-file $$distro.txt; done

# measure

bench: bridge  ## compare the bridge with a plain wrapper of the simulator (SHORT=1: half a minute)
	@$(IN_ENV) python tools/measure/bench.py $(if $(SHORT),--short)

soak: build  ## check the promises under faults and load (SHORT=1: half a minute)
	@$(IN_ENV) $(KILL_TREE) python tools/measure/soak.py $(if $(SHORT),--short)

test-heavy: env  ## run all other tests, as CI does after make test (half an hour)
	@$(RUN_TESTS) heavy

matrix: env  ## run the bridge's tests on every Python, distro and simulator here: PYTHONS= DISTROS= SIMULATORS=
	@$(RUN_TESTS) matrix

test-apriltag: env  ## run the detector's tests with apt's python3-apriltag (Debian 12, Ubuntu 22.04 and newer)
	@$(RUN_TESTS) apriltag

test-22-04: env  ## run the tests of the bridge and of the monorepo's nodes with the versions of Ubuntu 22.04
	@$(RUN_TESTS) ubuntu-22-04

# publish

mirror-publish: env  ## push the mirror: REMOTE=URL [RELEASE=2.1.0] [ARGS=--dry-run]
	@$(IN_ENV) python tools/mirror_publish.py $(call QUOTED,$(REMOTE)) $(if $(RELEASE),--release $(call QUOTED,$(RELEASE))) $(ARGS)

mirror-publish-check: env  ## publish the mirror to a local repository, clone it and follow its README
	@source ci/ros_env.bash without-overlay && $(KILL_TREE) python tools/mirror_publish_check.py

mirror-import: env  ## import patches of the mirror into the core and both trees: PATCH=N.patch
	@$(IN_ENV) python tools/mirror_import.py $(call QUOTED,$(PATCH))
