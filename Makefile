# What a newcomer types. Each target does its own set-up, in .venv (interop: .venv-interop) and nowhere else.
.DEFAULT_GOAL := help
.PHONY: help demo console docs test test-slow lint types check interop bench bench-clipseg bench-link bench-power bench-stopping bench-vision bench-cameras bench-perception bench-ground bench-field bench-mutants bench-modes bench-calls bench-attack house faults service vm deb image image-check clean
.PHONY: ready-sim ready-dev ready-export ready-interop

# A sourced ROS sets PYTHONPATH, and its packages and pytest plug-ins would come before ours.
unexport PYTHONPATH PYTHONHOME

PYTHON_IN_VENV := .venv/bin/python

# One worker more than cores: many tests wait for other processes.
WORKERS := $(shell echo $$(( $$(getconf _NPROCESSORS_ONLN 2>/dev/null || echo 1) + 1 )))

demo: ready-sim ## drive the simulated trail; AUTO=1 answers by itself, GUIDE=1 drives round things, SEED=7 another trail, OUT=folder
	@.venv/bin/companion demo $(if $(filter-out 0,$(AUTO)),--auto) $(if $(filter-out 0,$(GUIDE)),--guide) $${SEED:+--seed "$$SEED"} $${OUT:+--out "$$OUT"}

console: ready-sim ## the same trail, and you answer in a browser; SEED=7 another trail, OUT=folder
	@.venv/bin/companion demo --console $${SEED:+--seed "$$SEED"} $${OUT:+--out "$$OUT"}

PYTEST = $(PYTHON_IN_VENV) -m pytest -n $(WORKERS) --dist=loadfile --no-loadscope-reorder

# On a busy computer processes miss their limits: a test that fails beside others has to pass alone.
AGAIN = { [ $$? = 1 ] && echo "make: tests that failed beside others run again, alone" && \
	$(PYTHON_IN_VENV) -m pytest --last-failed --last-failed-no-failures none

test: ready-dev ## run the fast tests on all cores (under five minutes on two); ARGS="-k wheel" passes options on to pytest
	@$(PYTEST) -m "not slow" $(ARGS) || $(AGAIN) -m "not slow" $(ARGS); }

test-slow: ready-dev ## run the other tests: real processes, benches, parity with torch and transformers; ARGS as for test
	@$(PYTEST) -m slow $(ARGS) || $(AGAIN) -m slow $(ARGS); }

lint: ready-dev ## check style and format
	@$(PYTHON_IN_VENV) -m ruff check .
	@$(PYTHON_IN_VENV) -m ruff format --check .

types: ready-dev ## check types
	@$(PYTHON_IN_VENV) -m mypy

check: lint types test ## all three, as before a commit; `make test-slow` is the gate's fourth

docs: ready-dev ## build the pages as a site with search, in dist/site
	@NO_MKDOCS_2_WARNING=1 $(PYTHON_IN_VENV) -m mkdocs build --quiet --config-file .ci/docs/mkdocs.yml
	@echo "open it: python3 -m http.server --bind 127.0.0.1 --directory dist/site 8000, then http://127.0.0.1:8000/"

interop: ready-dev ready-interop ## talk to MAVProxy and MAVSDK themselves (1.2 GB of packages); ARGS as for test
	@INTEROP=.venv-interop $(PYTHON_IN_VENV) -m pytest tests/interop $(ARGS)

bench: ready-dev ## run all benchmarks (many hours), or some: ARGS=--quick (minutes), "growth link", --list; a page is made
	@$(PYTHON_IN_VENV) -m bench $(ARGS) $${OUT:+--out "$$OUT"}

bench-clipseg: ready-export ## time the bundles of any word against the authors' step (GBs of packages and models); ARGS=--quick, OUT=folder
	@$(PYTHON_IN_VENV) -m bench.clipseg $(ARGS) $${OUT:+--out "$$OUT"}

bench-link: ready-dev ## a bad radio, a million mutated frames, and how fast the link is; ARGS="lossy --calls 20"
	@$(PYTHON_IN_VENV) -m bench.link $(ARGS)

bench-stopping: ready-dev ## stop a rover by faults, 50 of each kind (half an hour); ARGS="--runs 2"
	@$(PYTHON_IN_VENV) -m bench.stopping $(ARGS)

bench-modes: ready-dev ## set modes by hand round the companion's own, over a slow wire (ten minutes); ARGS=--quick
	@$(PYTHON_IN_VENV) -m bench.modes $(ARGS)

bench-calls: ready-dev ## count the calls of simulated and real drives, and those that ask again (an hour); ARGS=--quick
	@$(PYTHON_IN_VENV) -m bench.calls $(ARGS)

bench-attack: ready-dev ## attack the companion on all that it reads, and its stations (nine minutes); ARGS="gate --quick"
	@$(PYTHON_IN_VENV) -m bench.attack $(ARGS)

bench-vision: ready-dev ## kill the vision process 200 times between an answer and its acknowledgement; ARGS="--kills 20"
	@$(PYTHON_IN_VENV) -m bench.vision.kills $(ARGS)

bench-cameras: ready-dev ## lose a camera 100 times and see when it is back; ARGS="--kind rtsp", http or pipe
	@$(PYTHON_IN_VENV) -m bench.cameras $(ARGS)

bench-perception: ready-dev ## how far the perceiver may be trusted, at home and abroad; ARGS="--perceiver builtin:FILE.onnx --sweep"
	@$(PYTHON_IN_VENV) -m bench.perception $(ARGS)

bench-ground: ready-dev ## how well the ground is known in metres, by a frame and by the grid (a quarter of an hour); ARGS=--quick
	@$(PYTHON_IN_VENV) -m bench.ground $(ARGS)

bench-field: ready-dev ## drive 50 random trails by report, hold and guide: contacts, ways, calls; ARGS="--runs 8", --truth
	@$(PYTHON_IN_VENV) -m bench.field_drive $(ARGS)

bench-power: ready-dev ## kill the companion at 500 points of its writes, and cut its power at 200; ARGS="--kills 20 --cuts 20"
	@$(PYTHON_IN_VENV) -m bench.faults.power_loss $(ARGS)

bench-mutants: ready-dev ## put faults into the safety path, 263 one at a time: do the tests notice? (hours)
	@$(PYTHON_IN_VENV) -m bench.mutants $(ARGS)

house: ready-dev ## how simple the code is: lines, files, floors of imports, and how many files an event passes
	@$(PYTHON_IN_VENV) -m bench.house

faults: ready-dev ## produce every fault of docs/faults.md and see what follows (an hour); ARGS="--only camera --short"
	@$(PYTHON_IN_VENV) -m bench.faults $(ARGS)

service: ready-dev ## prove the installed service in a booted Debian container (ten minutes, root)
	@$(PYTHON_IN_VENV) -m bench.service $(ARGS)

vm: ready-dev ## as root: cameras, autopilot and OAK in an emulated machine, each pulled and plugged in ten times
	@$(PYTHON_IN_VENV) -m bench.service --only devices
	@$(PYTHON_IN_VENV) -m bench.cameras.kernel "$${XDG_CACHE_HOME:-$$HOME/.cache}/anytraverse-service/vm"

deb: ## build a Debian package of the service in dist/, for this system's Python
	@sh .ci/deb.sh

image: ## build an OCI image of the service in dist/, for podman (root); ARCH=arm64 takes the package of such a computer
	@sh .ci/image.sh

image-check: ready-dev ## prove that image by podman: start, stop, kill, hang, devices, data (five minutes, root)
	@$(PYTHON_IN_VENV) -m bench.service.image $(ARGS)

clean: ## remove both .venv, caches and builds (what a demo or a bench wrote stays)
	@rm -rf .venv .venv-interop build dist .mypy_cache .ruff_cache .pytest_cache .hypothesis
	@find . -name __pycache__ -type d -prune -exec rm -rf {} +

help: ## this list; PYTHON=python3.12 before or after any target chooses the interpreter
	@sed -n 's/^\([a-z-]*\):.*## \(.*\)/\1	\2/p' $(firstword $(MAKEFILE_LIST)) | while IFS='	' read -r name what; do \
		printf '  make %-14s %s\n' "$$name" "$$what"; done

# Three set-ups in one .venv, and one apart: the first demo waits only for what a rover and the simulated field need.
# The developer's tools, several times as big, come with the first `make test`, and what makes bundles of networks with the first bench.
ready-sim ready-dev ready-export ready-interop: ready-%:
	@GOAL='$(firstword $(MAKECMDGOALS))' sh .ci/setup.sh $*
