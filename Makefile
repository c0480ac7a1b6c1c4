# SPDX-License-Identifier: Apache-2.0
# From a fresh clone each target sets up what it needs first; the second time only what changed.

SHELL := bash
.DEFAULT_GOAL := setup

# A sourced ROS installation or another venv must not leak into what is run here.
unexport PYTHONPATH PYTHONHOME AMENT_PREFIX_PATH CMAKE_PREFIX_PATH COLCON_PREFIX_PATH
unexport LD_LIBRARY_PATH _ROS_WHEELS_BOOTSTRAP_COMPLETE

# Interpreter for .venv; without it the first suited one on the path is taken.
ifdef PYTHON
export PYTHON
endif

.PHONY: setup demo wheel docs unit test lint audit pin bench soak studies clean

setup:
	@tools/setup.sh

# `make demo -- iiwa14`: another arm or probe, into output/demo_iiwa14.
VARIANT := $(filter passive iiwa14 faro,$(MAKECMDGOALS))
ifneq ($(VARIANT),)
.PHONY: $(VARIANT)
$(VARIANT): demo ; @:
endif

demo: setup
	@echo 'demo: a whole calibration in simulation, about a minute'
	@source ./env.bash && for variant in $(or $(VARIANT),kr5); do \
	  python -m calib_bringup.demo --variant $$variant || exit; done

lint:
	@tools/setup.sh --dev
	@echo 'lint: ruff and mypy, a minute where mypy has not run before'
	@source ./env.bash && ruff check . && ruff format --check . && mypy

# Known vulnerabilities of what is pinned. What it finds is told and fails nothing: tomorrow's news
# must not break what was right today, nor must a database that cannot be reached.
AUDIT := pip-audit --vulnerability-service osv --disable-pip --require-hashes --timeout 10 \
  --progress-spinner off -r requirements.txt -r requirements-dev.txt

audit:
	@tools/setup.sh --dev
	@source ./env.bash && log=$$(mktemp) && trap 'rm -f "$$log"' EXIT && \
	{ $(AUDIT) 2>"$$log" || true; echo "audit: $$(tail -n 1 "$$log")"; }

# requirements*.txt from requirements*.in. Versions stay as they are where they still fit;
# `make pin UPGRADE=--upgrade` takes the newest. What was tried is told in docs/security.md.
PIN := uv pip compile --quiet --universal --python-version 3.10 --fork-strategy fewest \
  --generate-hashes --no-annotate --no-emit-package pip

pin:
	@tools/setup.sh --dev
	@source ./env.bash && export UV_CUSTOM_COMPILE_COMMAND='make pin' && \
	$(PIN) $(UPGRADE) requirements.in -o requirements.txt && \
	$(PIN) $(UPGRADE) requirements-dev.in -o requirements-dev.txt && \
	$(PIN) $(UPGRADE) requirements-docs.in -o requirements-docs.txt

# The suite without ROS, into dist/, for each suited interpreter that is at hand.
wheel:
	@tools/setup.sh --dev
	@tools/wheel.sh

# The site, read from output/docs/index.html without a network. What builds it is in a virtual
# environment of its own.
docs:
	@tools/setup.sh --dev
	@[ -d .venv-docs ] || .venv/bin/uv venv --quiet --python .venv/bin/python .venv-docs
	@env $$(.venv/bin/python -m pip config list | .venv/bin/python tools/uv_settings.py) \
	  .venv/bin/uv pip install --quiet --python .venv-docs/bin/python --no-deps --require-hashes \
	  -r requirements-docs.txt
	@NO_MKDOCS_2_WARNING=1 .venv-docs/bin/mkdocs --quiet build --strict && echo output/docs/index.html

# A file of tests at a time on each worker: what they share is set up once, graphs keep apart. One
# worker more than cores, as tests of processes wait much of the time.
test: lint
	@echo 'test: every test, ten to fifteen minutes on 2 cores; `make unit` takes one'
	@source ./env.bash && python -m pytest -n $$(($$(nproc) > 3 ? 4 : $$(nproc) + 1)) \
	  --dist loadfile --no-loadscope-reorder

# What starts no process and no graph and is quick, for between two edits. One thread each, as the
# tests themselves go side by side.
unit:
	@tools/setup.sh --dev
	@source ./env.bash && export CALIB_THREADS=1 && \
	python -m pytest -n auto --maxprocesses 4 --dist loadfile -m 'not system and not slow'

# Faults and load for as long as it takes to trust them; the last figures go to docs/soak.md. The
# load has the machine for itself, the rest goes two files at a time.
soak: lint
	@rm -f output/soak.json
	@echo 'soak: load, signals, faults, recordings of an hour; an hour or two on 2 idle cores'
	@source ./env.bash && export SOAK=1 FAULT_ROUNDS=30 CAPTURE_KILLS=20 CAPTURE_KILLS_SEED=1 && \
	python -m pytest tests/test_load.py && \
	python -m pytest -n 2 --dist loadfile --no-loadscope-reorder tests/test_ending.py \
	  tests/test_large_recordings.py tests/test_faults_*.py \
	  ros2_ws/src/calib_capture/test/recording/test_resume.py

bench: setup
	@source ./env.bash && python -m benchmarks.run

# Each writes its table to studies/results; all together take some minutes on 2 cores. Those that
# need one core go two at a time.
ONE_CORE := table_1 equation_13 table_2 figure_7 figure_8 figure_9 section_6
TWO_CORES := pattern correction coverage recovery robustness named_faults probe_fit prior hard_starts model_errors pose_choice compensation points

studies: setup
	@source ./env.bash && \
	printf '%s\n' $(ONE_CORE) | xargs -P 2 -I NAME python -m studies.NAME && \
	for name in $(TWO_CORES); do python -m studies.$$name || exit 1; done

clean:
	rm -rf .venv .venv-docs build dist ros2_ws/build ros2_ws/install ros2_ws/log output
	find ros2_ws/src -name '*.so' -delete
	find ros2_ws/src -name '*.egg-info' -prune -exec rm -rf {} +
