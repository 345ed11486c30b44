# Every target sets up what is missing first; a set-up that is up to date costs a fraction of a second.
SHELL := /bin/bash
.DEFAULT_GOAL := help
.PHONY: help setup messages run test lint docs bench same-bits soak chaos fuzz two-hosts clean

# Settings for the command line:
PYTHON ?=
TASK ?= qd_walker
ARGS ?=
REV ?= HEAD
WORKERS ?= 3

BENCHES := rollout reset critic pg_variation graph archive scaling paper_scale

SETUP := PYTHON="$(PYTHON)" scripts/setup.sh
IN_VENV := . .venv/setup.bash &&

help: ## Show this list
	@sed -nE 's/^([a-z-]+):.*## (.*)/  make \1\t\2/p' Makefile | expand -t 18
	@echo
	@echo '  TASK=qd_hopper picks config/qd_hopper.yaml for run; ARGS="..." goes to run (ROS arguments, as'
	@echo '  -p evaluations:=20000), test (pytest options) and bench; PYTHON=/path/to/python3.11 to setup.'

setup: ## Bring .venv up to date (every other target does this by itself)
	@$(SETUP)

messages: ## Bring the message package in .venv up to date, and only that
	@$(SETUP) messages

run: setup ## Grow a repertoire, query it from another process, run the gait that came back
	@$(IN_VENV) exec python -m pga_me_ros.demo --params-file config/$(TASK).yaml $(ARGS)

test: setup ## Run all checks and tests
	@$(IN_VENV) ROS_PYTHON_CHECK_FIELDS=1 exec python -m pytest -n $(WORKERS) --dist loadscope --no-loadscope-reorder $(ARGS)

lint: setup ## Run only the checks of style and types
	@$(IN_VENV) exec python -m pytest -q test/packaging/test_lint.py

docs: setup ## Write docs/parameters.md and docs/interface.md anew, build docs/ as a site into build/site
	@$(IN_VENV) parameters=$$(python scripts/parameter_docs.py) && interface=$$(python scripts/interface_docs.py) && \
	    echo "$$parameters" > docs/parameters.md && echo "$$interface" > docs/interface.md && \
	    exec python -m mkdocs build --strict

bench: setup ## Run the benchmarks
	@$(IN_VENV) for name in $(BENCHES); do echo "== $$name"; python "bench/$$name.py" $(ARGS) || exit 1; done

same-bits: setup ## Compare the results of tiny runs with those of the revision REV (HEAD), bit for bit
	@$(IN_VENV) exec python bench/same_bits.py $(REV) $(ARGS)

soak: setup ## Watch the memory of a run of 1,000 generations (an hour)
	@$(IN_VENV) exec python bench/soak.py $(ARGS)

chaos: setup ## Kill a run's processes at random moments, for minutes, and compare what it ends with
	@$(IN_VENV) exec python bench/chaos.py $(ARGS)

fuzz: setup ## Send 10,000 bad requests and messages to a run under way, and compare what it ends with
	@$(IN_VENV) exec python bench/fuzz.py $(ARGS)

two-hosts: setup ## Runs on two hosts made of network namespaces, whose cable is pulled (about 3 minutes)
	@$(IN_VENV) exec python -m pytest -m two_hosts test/graph/test_two_hosts.py $(ARGS)

clean: ## Remove what set-up, builds and tools left, but no run directory
	rm -rf .venv build install log dist *.egg-info .hypothesis .mypy_cache .pytest_cache .ruff_cache
