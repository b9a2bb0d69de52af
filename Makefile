# make run   plays the default scenario: three nodes, a live page, a recording, surveys against the truth
# make test  lint, types, unit tests, nodes on a middleware domain of their own
PYTHON ?= python3
BIN := .venv/bin
# What another sourced ROS would put in front of ours.
CLEAN := env -u PYTHONPATH -u AMENT_PREFIX_PATH -u LD_LIBRARY_PATH -u ROS_DISTRO -u _ROS_WHEELS_BOOTSTRAP_COMPLETE

.PHONY: run test setup lint config lock bench clean

setup:
	@$(PYTHON) .ci/setup

run: setup
	@$(CLEAN) $(BIN)/mwd run

lint: setup
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/mypy mwd_sensors/mwd_sensors mwd_estimation/mwd_estimation mwd_surface/mwd_surface
	@$(BIN)/python .ci/config --check

test: lint
	@$(CLEAN) $(BIN)/python -m pytest

# Accuracy and speed against the papers and the peers, in one run; writes tests/benchmarks/BENCHMARKS.md.
bench: setup
	@$(BIN)/python -m pip install -q --no-deps --disable-pip-version-check -r .ci/bench.lock
	@$(CLEAN) $(BIN)/python tests/benchmarks/bench.py

config: setup
	@$(BIN)/python .ci/config

lock: setup
	@$(BIN)/python .ci/lock

clean:
	rm -rf .venv .venv.turn
