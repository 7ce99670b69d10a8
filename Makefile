# `make demo` and `make test` set everything up by themselves. Another Python: `make setup PYTHON=python3.12`.
PYTHON ?= python3
BIN := .venv/bin
SHELL := /bin/bash
.DEFAULT_GOAL := help

# A sourced ROS 2 looks for libraries along these; without one, the wheels find their own.
ifdef AMENT_PREFIX_PATH
export LD_LIBRARY_PATH := $(CURDIR)/.venv/lib:$(LD_LIBRARY_PATH)
export AMENT_PREFIX_PATH := $(CURDIR)/.venv:$(AMENT_PREFIX_PATH)
endif
# A guard that the ROS wheels leave behind in the shell of another environment: it must not reach this one.
unexport _ROS_WHEELS_BOOTSTRAP_COMPLETE

.PHONY: help setup demo test browser lint bench clean

help: ## list the targets
	@sed -n 's/^\([a-z]*\):.*## \(.*\)/make \1	\2/p' $(MAKEFILE_LIST)

setup: ## make .venv with all that is needed (does nothing when done)
	@$(PYTHON) scripts/set_up.py

demo: setup ## track the bundled recording live, over ROS 2
	@$(BIN)/python -m etd_ros demo --output demo

# The live nodes' tests listen over DDS in their own process, without what all other tests have loaded into theirs: a crash
# in native code was seen there once.
test: lint browser ## all checks and tests
	ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST $(BIN)/python -m pytest --ignore=test/nodes
	ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST $(BIN)/python -m pytest test/nodes

browser: ## get Chromium for the tests of the labelling page (as root with apt; does nothing when it is there)
	@$(PYTHON) scripts/get_browser.py

lint: setup ## style and types
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	$(BIN)/mypy scripts/set_up.py
	$(BIN)/mypy scripts/get_browser.py

bench: setup .venv-bench/.done ## measure speed beside other packages, in .venv-bench, and the live node; writes benchmarks/
	@.venv-bench/bin/python -m etd_ros benchmark event-path tracker --write benchmarks
	@.venv-bench/bin/python -m etd_ros benchmark --scaling docs/scaling.png
	@$(BIN)/python -m etd_ros benchmark live --write benchmarks

# An environment of its own: the other packages have requirements of theirs.
.venv-bench/.done: setup.py scripts/requirements-runtime.txt
	$(PYTHON) -m venv .venv-bench
	.venv-bench/bin/python -m pip install --quiet -r scripts/requirements-runtime.txt -e ".[bench,plot]"
	touch $@

clean: ## remove .venv, .venv-bench and everything generated
	rm -rf .venv .venv-bench demo build install log *.egg-info .mypy_cache .ruff_cache .pytest_cache .hypothesis
	find etd_ros msg_adapters test scripts launch -name __pycache__ -type d -prune -exec rm -rf {} +
