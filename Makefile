# make run    plays the default scenario: three nodes, a live page, a recording, surveys against the truth
# make test   lint, types and every test: kernels, real nodes on middleware domains of their own, the page in a browser
# make check  lint, types and the fast tests, before each commit
# make test-ubuntu  the same tests with the versions of Ubuntu 24.04's Python packages, on Python 3.12
# make bench  accuracy and speed against the papers and the peers; writes docs/benchmarks.md
# make papers  the tables and figures of the papers S0, S1 and S3, computed next to the printed values: docs/papers.md
# make cortex  instructions of S3's filters on a Cortex-M3, in emulation (needs gcc-arm-none-eabi and qemu-system-arm)
# make fuzz   generated input against every parser, for long (the suite does it for short); INPUTS=500: of so many each
# make nightly  what the gate asserts with few seeds and examples, with many; then `make fuzz` and `make sweep`
# make sweep  every scenario with requests of people, live and afterwards: equal lists; SECONDS=100: of so many each
# make soak   an hour of the graph at ten times its pace with kills, LOSS=0.3: over a network that loses and reorders
# make mutate ROOM=health  which constants of a room no test of it notices, each scaled by 0.7 and 1.4; takes long
# make font   the font of Chinese texts, a subset of Noto Sans SC
# make words  the texts of the sources, into the catalogues of the languages
# make sbom   the locked packages as CycloneDX
# make deb    out/mwd_*.deb: ROS 2, messages, packages and mwd in /opt/mwd, for machines of this distribution
# make docs   the site, in docs/_build/html
# make pictures  the pictures of the page in README and docs, from the run of `make run`
# make tour  the commands of the README one after the other, with their times, into docs/tour.md
PYTHON ?= python3
BIN := .venv/bin
# What another sourced ROS would put in front of ours. Byte code is kept: each worker of the tests would compile them all
# anew, half of the time that it needs to find them.
CLEAN := env -u PYTHONDONTWRITEBYTECODE -u PYTHONPATH -u AMENT_PREFIX_PATH -u LD_LIBRARY_PATH -u ROS_DISTRO -u _ROS_WHEELS_BOOTSTRAP_COMPLETE
# A file of tests stays with one worker: its fixtures are made once. Four of them keep two cores busy, for two mostly
# wait for real nodes; conftest.py has their order. Nodes check the type of each field that they send: without the
# check, ROS sends an integer in a field of floats as another number.
PYTEST = $(CLEAN) ROS_PYTHON_CHECK_FIELDS=1 $(BIN)/python -m pytest --numprocesses 4 --dist loadfile --no-loadscope-reorder

.PHONY: run test suite test-ubuntu check setup lint config docs pictures tour words font lock bench papers cortex fuzz soak nightly sweep mutate sbom deb clean

setup:
	@$(PYTHON) .ci/setup

run: setup
	@$(CLEAN) $(BIN)/mwd run

lint: setup
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/mypy mwd_sensors/mwd_sensors mwd_estimation/mwd_estimation mwd_surface/mwd_surface
	@$(BIN)/python .ci/config --check

check: lint
	@$(PYTEST) --numprocesses 2 -m "not slow and not ros and not nightly" --durations 20 --durations-min 0.5

# One core checks the types while the other begins with the tests.
test:
	@$(MAKE) --no-print-directory --jobs 2 lint suite

# The first pass writes the byte code of all tests: four workers that start together would each make all of it.
suite: setup
	@$(CLEAN) $(BIN)/python -m pytest --collect-only -qq > /dev/null || true
	@$(PYTEST) -m "not nightly"

test-ubuntu: BIN := .venv-ubuntu/bin
test-ubuntu:
	@$(PYTHON) .ci/setup --ubuntu
	@$(PYTEST) -m "not nightly" $(ONLY)

bench: setup
	@$(BIN)/python -m pip install -q --no-deps --disable-pip-version-check --require-hashes -r .ci/bench.lock
	@$(CLEAN) $(BIN)/python tests/benchmarks/bench.py $(if $(ONLY),--only $(ONLY))

papers: setup
	@$(CLEAN) PYTHONPATH=tests OPENBLAS_NUM_THREADS=1 $(BIN)/python tests/benchmarks/papers.py $(if $(ONLY),--only $(ONLY))

cortex: setup
	@$(CLEAN) PYTHONPATH=tests OPENBLAS_NUM_THREADS=1 $(BIN)/python tests/benchmarks/cortex_m3/instruction_count.py

docs: setup
	@$(BIN)/python -m pip install -q --no-deps --disable-pip-version-check --require-hashes -r .ci/docs.lock
	@$(CLEAN) $(BIN)/python -m sphinx -W -q -b html docs docs/_build/html
	@echo "docs/_build/html/index.html"

pictures: setup
	@$(CLEAN) $(BIN)/python docs/pictures.py

tour: setup
	@$(CLEAN) $(BIN)/python docs/tour.py

deb: setup
	@$(CLEAN) $(BIN)/python .ci/deb

config: setup
	@$(BIN)/python .ci/config

words: setup
	@$(BIN)/python .ci/words

font: setup
	@$(BIN)/python .ci/font

lock: setup
	@$(BIN)/python .ci/lock

fuzz: setup
	@HYPOTHESIS_PROFILE=fuzz FUZZ_INPUTS=$(or $(INPUTS),5000) $(CLEAN) $(BIN)/python -m pytest -m fuzz --hypothesis-show-statistics $(ONLY)

nightly: setup
	@HYPOTHESIS_PROFILE=nightly $(PYTEST) -m "nightly or hypothesis"
	@$(MAKE) fuzz sweep

sweep: setup
	@SWEEP_SECONDS=$(or $(SECONDS),240) $(PYTEST) --numprocesses 2 --dist load -k scenario mwd_surface/test/processing/test_live_and_afterwards.py

mutate: setup
	@$(CLEAN) $(BIN)/python .ci/mutate $(ROOM) $(ONLY)

soak: setup
	@$(CLEAN) $(BIN)/python tests/soak.py $(if $(MINUTES),--minutes $(MINUTES)) $(if $(LOSS),--loss $(LOSS))

sbom: setup
	@$(BIN)/python .ci/sbom

clean:
	rm -rf .venv .venv.turn .venv-ubuntu .venv-ubuntu.turn docs/_build
