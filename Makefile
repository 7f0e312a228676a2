# `make demo` and `make test` do everything from an empty clone; see README.md.
# A sourced ROS never mixes with the wheels of .venv: its variables end here.
unexport PYTHONPATH AMENT_PREFIX_PATH COLCON_PREFIX_PATH CMAKE_PREFIX_PATH LD_LIBRARY_PATH ROS_DISTRO ROS_VERSION ROS_PYTHON_VERSION
export PYTHONUNBUFFERED = 1

PYTHON ?= python3
PYTEST := -m pytest -n 2 --dist loadfile --no-loadscope-reorder
BIN := .venv/bin
PACKAGES := grasp_common barrett_hand_bridge shell_deform scan_compare grasp_replay grasp_view
SOURCES := $(addprefix ros2_ws/src/,$(PACKAGES))
EDITABLE := $(addprefix -e ./,$(SOURCES))
SETUPS := $(addsuffix /setup.py,$(SOURCES))
COMPILE := uv pip compile --universal --python-version 3.10 --generate-hashes --no-emit-index-url --no-emit-find-links --no-header

.PHONY: help setup demo test test-cell soak mutants bench bench-peers bags pictures tables docs lock lint clean

help:  ## this list
	@grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/^([a-z-]+):.*## /  make \1\t/' | expand -t 20

setup: .venv/.ready  ## all of .venv: nodes and commands, kernels, TF and actions, tests, documentation

# What nodes and commands need: two thirds of the whole, in half the time.
.venv/.run: requirements/lock-run.txt $(SETUPS)
	@sh requirements/install.sh "$(PYTHON)" .venv requirements/lock-run.txt $(EDITABLE)
	@touch $@

.venv/.ready: .venv/.run requirements/lock.txt
	@sh requirements/install.sh "$(PYTHON)" .venv requirements/lock.txt
	@$(BIN)/python requirements/build_interfaces.py
	@touch $@

.venv-cell/.ready: requirements/lock-cell.txt $(SETUPS)
	@sh requirements/install.sh "$(PYTHON)" .venv-cell requirements/lock-cell.txt $(EDITABLE)
	@.venv-cell/bin/python requirements/build_interfaces.py
	@touch $@

demo: .venv/.run  ## the recorded grasp through the three live nodes, then the paper's Table I beside ours
	@$(BIN)/python tests/demo.py

# numpy 2.2, the last for Python 3.10, has other types than its successors.
lint: setup
	@$(BIN)/ruff check . && $(BIN)/ruff format --check . && $(BIN)/python -m tests.sizes
	@if $(BIN)/python -c 'import sys; sys.exit(sys.version_info < (3, 11))'; \
	then $(BIN)/mypy $(foreach p,$(PACKAGES),ros2_ws/src/$(p)/$(p)); \
	else echo 'Types are not checked: that needs Python 3.11 or later'; fi

test: lint  ## lint, types and all tests, with a colcon build of the workspace
	@$(BIN)/python $(PYTEST)

test-cell: .venv-cell/.ready  ## the tests again with the numpy and scipy of Ubuntu 24.04
	@.venv-cell/bin/python $(PYTEST)

soak: setup  ## the long figures: 10^6 mutations, 10-minute runs, 200 seeds; table in docs/
	@$(BIN)/python tests/soak.py

mutants: setup  ## 100 small changes of the code, sampled by a seed: do the tests see them?
	@$(BIN)/python -m tests.mutants --count 100 --seed 1 --slow 60

bench: setup  ## performance and fidelity tables, side by side with the peers that are installed
	@$(BIN)/python tests/benchmarks/run.py

bench-peers:  ## Kratos and MuJoCo in .venv-bench, for the tables of `make bench`
	@"$(PYTHON)" -m venv .venv-bench
	@.venv-bench/bin/pip install --quiet -r requirements/bench.txt

bags: setup  ## the recordings again, from the kept solid solutions
	@$(BIN)/python bags/generate.py
	@$(BIN)/python -m bags.turning
	@$(BIN)/python -m bags.fingertips

pictures: setup  ## the pictures of README and docs again
	@$(BIN)/python -m docs.make_pictures

tables: setup  ## the tables of parameters (package READMEs) and options (docs/options.md) and the picture of the rooms again
	@$(BIN)/python -m docs.parameter_tables
	@$(BIN)/python -m docs.option_tables
	@$(BIN)/python -m docs.rooms

docs: setup  ## the documentation site in out/site, with a reference from the docstrings
	@$(BIN)/python -m docs.site

lock:  ## compile the locked requirements again (needs uv)
	$(COMPILE) requirements/requirements.in -o requirements/lock.txt
	$(COMPILE) -c requirements/lock.txt requirements/run.in -o requirements/lock-run.txt
	$(COMPILE) -c requirements/cell-constraints.txt requirements/requirements.in -o requirements/lock-cell.txt

clean:
	rm -rf .venv .venv-cell ros2_ws/build ros2_ws/install ros2_ws/log out
