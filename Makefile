# Every target first sets up what is missing; if nothing is, that takes a fraction of a second.
SHELL := /bin/bash
.DEFAULT_GOAL := help
.PHONY: help setup messages run test test-pythons lint docs bench same-bits same-speed soak chaos fuzz two-hosts clean

# Set these on the command line:
PYTHON ?=
TASK ?= qd_hopper
ARGS ?=
REV ?= HEAD
OLDER ?=
WORKERS ?= 4

BENCHES := startup rollout reset critic pg_variation graph archive scaling paper_scale

SETUP := PYTHON="$(PYTHON)" scripts/setup.sh
IN_VENV := . .venv/setup.bash &&

help: ## Show this list
	@sed -nE 's/^([a-z-]+):.*## (.*)/  make \1\t\2/p' Makefile | expand -t 18
	@echo
	@echo '  TASK=qd_walker                run with config/qd_walker.yaml'
	@echo '  ARGS="-p evaluations:=20000"  pass arguments on: to run (ROS arguments), test (pytest options),'
	@echo '                                and bench, soak, chaos, fuzz, two-hosts'
	@echo '  WORKERS=4                     number of parallel test processes'
	@echo '  PYTHON=/path/to/python3.12    use this Python for the setup (3.11, 3.12 or 3.13)'

setup: ## Create or update .venv (every other target does this itself)
	@$(SETUP)

messages: ## Update only the message package in .venv
	@$(SETUP) messages

run: setup ## Grow a small repertoire, request a behavior from another process, run it
	@$(IN_VENV) exec python -m pga_me_ros.demo --params-file config/$(TASK).yaml $(ARGS)

test: setup ## Run all checks and tests
	@$(IN_VENV) ROS_PYTHON_CHECK_FIELDS=1 exec python -m pytest -n $(WORKERS) --dist loadscope --no-loadscope-reorder $(ARGS)

test-pythons: setup ## Run the tests on each of Python 3.11, 3.12 and 3.13 that is found, in copies of the last commit
	@WORKERS=$(WORKERS) exec scripts/test_pythons.sh $(ARGS)

lint: setup ## Run only the style and type checks
	@$(IN_VENV) exec python -m pytest -q test/packaging/test_lint.py

docs: setup ## Regenerate docs/parameters.md and docs/interface.md, build the site in build/site
	@$(IN_VENV) parameters=$$(python scripts/parameter_docs.py) && interface=$$(python scripts/interface_docs.py) && \
	    echo "$$parameters" > docs/parameters.md && echo "$$interface" > docs/interface.md && \
	    exec python -m mkdocs build --strict

bench: setup ## Run the benchmarks
	@$(IN_VENV) for name in $(BENCHES); do echo "== $$name"; python "bench/$$name.py" $(ARGS) || exit 1; done

same-bits: setup ## Compare the results of tiny runs with those of the revision REV (HEAD), bit for bit
	@$(IN_VENV) exec python bench/same_bits.py $(REV) $(ARGS)

same-speed: setup ## Compare the speed with that of an older clone that is set up, OLDER=FOLDER (about 15 minutes)
	@$(IN_VENV) exec python bench/same_speed.py $(OLDER) $(ARGS)

soak: setup ## Measure memory over 1,000 generations (about an hour)
	@$(IN_VENV) exec python bench/soak.py $(ARGS)

chaos: setup ## Kill a run's processes at random moments and check its result (minutes)
	@$(IN_VENV) exec python bench/chaos.py $(ARGS)

fuzz: setup ## Send 10,000 bad requests and messages to a run and check its result (minutes)
	@$(IN_VENV) exec python bench/fuzz.py $(ARGS)

two-hosts: setup ## Run on two simulated hosts whose network connection is cut (about 3 minutes)
	@$(IN_VENV) exec python -m pytest -m two_hosts test/graph/test_two_hosts.py $(ARGS)

clean: ## Remove the environment, builds and caches; keeps run directories
	rm -rf .venv build install log dist *.egg-info .hypothesis .mypy_cache .pytest_cache .ruff_cache
