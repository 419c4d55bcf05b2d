# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
#
# Each target works on a fresh clone and says what it does. The work is in scripts/.

SHELL := /bin/bash
PYTHON := .venv/bin/python
# A worker that has nothing left to do takes tests over from another one.
SEVERAL := --numprocesses auto --dist worksteal

.DEFAULT_GOAL := help
.PHONY: help setup demo test test-numpy1 lint format bench colcon docs clean

help:  ## show this list
	@sed -n 's/^\([a-z0-9-]*\):.*  ## \(.*\)/  make \1|\2/p' Makefile | column -t -s '|' 2>/dev/null \
	  || grep '  ## ' Makefile

setup:  ## make .venv with everything in it (a second time: nothing to do)
	@scripts/setup.sh

demo: setup  ## record, learn, monitor and train with real nodes, in under 5 minutes
	@.venv/bin/occ demo

# The workers share the cores, so each uses one thread.
test test-numpy1: export OMP_NUM_THREADS := 1

test: setup  ## run all tests but the slow ones, several at a time
	@$(PYTHON) -m pytest $(SEVERAL)

test-numpy1:  ## the same with NumPy 1.26, which ROS 2 Jazzy ships, in .venv-numpy1
	@scripts/setup.sh --venv .venv-numpy1 --pins requirements/pins-numpy1.txt
	@.venv-numpy1/bin/python -m pytest $(SEVERAL)

lint: setup  ## check Python (style and types), shell, Docker and YAML files
	@scripts/lint.sh

format: setup  ## rewrite Python files the way lint wants them
	@.venv/bin/ruff check --fix
	@.venv/bin/ruff format

bench: setup  ## measure training over topics and rule evaluation, as JSON
	@$(PYTHON) -m benchmarks loop --json
	@$(PYTHON) -m benchmarks rules --json

colcon: setup  ## build ros2_ws with colcon, test the package, start one node out of its install tree
	@scripts/colcon.sh

docs: setup  ## build the site of the documentation in site/, all links checked
	@scripts/site.sh

clean:  ## remove environments and everything that was built
	rm -rf .venv .venv-numpy1 .venv-colcon .venv-site build site ros2_ws/build ros2_ws/install ros2_ws/log
	rm -rf .pytest_cache .ruff_cache .mypy_cache .hypothesis src/occ_constraints_pkg/build \
	  src/occ_constraints_pkg/*.egg-info
	find src tests experiments benchmarks -name __pycache__ -type d -prune -exec rm -rf {} +
