# From a bare clone: `make demo` and `make test` set up what they need, once.
# Needs Python 3.11 or 3.12 with venv; nothing else, not even ROS.

VENV := .venv
BIN := $(VENV)/bin
SYSTEM_PYTHON := $(shell for p in "$(PYTHON)" python3 python3.12 python3.11; do \
  "$$p" -c 'import sys; sys.exit(sys.version_info[:2] not in ((3, 11), (3, 12)))' 2>/dev/null && echo "$$p" && break; done)
ENVIRONMENT := OPENBLAS_NUM_THREADS=1
# Not setup.sh: what colcon writes there of a folder with a blank is no path.
IN_WORKSPACE := . install/local_setup.sh && $(ENVIRONMENT)
SOURCES := $(shell find dvrk_gravity config launch resource -type f -not -name '*.pyc') setup.py setup.cfg package.xml

# The ROS wheels carry distributions inside (rclpy in ros-rclpy): those are not on the index.
OF_THE_INDEX := awk -F== '{ n = tolower($$1); gsub("_", "-", n); if (n != "pip") line[n] = $$0 } \
  END { for (n in line) if (!(("ros-" n) in line)) print line[n] }' | sort

.PHONY: bench calibrate-demo demo dist dist-check docs peers story test test-long trials trials-real sensitivity lint lock clean help

help:
	@echo "make demo    fall, float, push, kill: the whole system in simulation (out/demo/ARM); ARM=… for another arm"
	@echo "make calibrate-demo  from a simulated arm to a model with a certificate, some minutes (out/calibrate)"
	@echo "make test    the test suite: what computes (WORKERS=2), then live nodes one at a time"
	@echo "make test-long  properties, sweeps, pages, packaging, browser: test/trials"
	@echo "make bench   every benchmark, under ten minutes (MINUTES=30 for the long soak)"
	@echo "make lint    ruff and mypy"
	@echo "make docs    the site in out/site; a warning is an error"
	@echo "make trials  the long tests, properties with many examples, hundreds of trials of hide and find, with exact models and with identified ones (SEEDS=\"0 12\")"
	@echo "make trials-real  known effects put into recordings of real arms, and looked for (DVRK_GRAVITY_DATA)"
	@echo "make sensitivity  halve and double every threshold of estimation, and tell what moves"
	@echo "make story   the diagnosis on real recordings: docs/real_data.md, docs/psm.md (DVRK_GRAVITY_DATA)"
	@echo "make peers   this package beside least squares, figaroh and mujoco.sysid, on the same recordings: docs/peers.md (QUICK=1: two arms, printed only)"
	@echo "make dist    wheel and sdist in dist/; make dist-check tries both in fresh environments"
	@echo "make lock    renew requirements.lock from requirements.in"
	@echo "make clean   remove what make has made"

$(VENV)/.done: requirements.lock
	@test -n "$(SYSTEM_PYTHON)" || { echo "make: needs Python 3.11 or 3.12 (PYTHON=… to name one)"; exit 2; }
	@echo "$(VENV): installing requirements.lock with $(SYSTEM_PYTHON), once; takes some minutes"
	@rm -rf $(VENV)
	@"$(SYSTEM_PYTHON)" -m venv $(VENV)
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps -r requirements.lock
	@touch $(VENV)/COLCON_IGNORE $@

install/.done: $(VENV)/.done $(SOURCES)
	@echo "install: building with colcon"
	@$(BIN)/colcon --log-level error build --packages-select dvrk_gravity
	@touch $@

demo: install/.done
	@name=$$(basename "$$ARM"); $(IN_WORKSPACE) $(BIN)/python -m dvrk_gravity demo --arm "$$ARM" --out "out/demo/$${name%.*}"
# By the shell, and not by make, which takes a path with a blank for two.
ARM ?= mtmr
export ARM

# Anew each time; without `rm`, it would go on with the last one.
calibrate-demo: install/.done
	@rm -rf out/calibrate; mkdir -p out
	@$(IN_WORKSPACE) $(BIN)/python -m dvrk_gravity calibrate --arm psm --simulated --out out/calibrate \
	  --time 10 --no-rehearsal

# What computes first, on all cores; then nodes over DDS, one test at a time, on a machine that is idle.
# Both, whatever the first says. Compiled modules are kept, whatever the environment says: each of the
# nodes is a process, which would compile some 200 anew.
TESTED := $(IN_WORKSPACE) PYTHONDONTWRITEBYTECODE=
test: install/.done
	@$(TESTED) $(BIN)/python -m pytest -n $(WORKERS) --dist loadfile; computed=$$?; \
	$(TESTED) $(BIN)/python -m pytest test/live && exit $$computed
WORKERS ?= 2

# Properties, sweeps over all arms, what pages say, packaging, a browser; then nodes as above.
test-long: install/.done
	@$(TESTED) DVRK_GRAVITY_EXAMPLES=$(EXAMPLES) $(BIN)/python -m pytest -n $(WORKERS) --dist loadfile test/trials --ignore test/trials/live; computed=$$?; \
	$(TESTED) $(BIN)/python -m pytest test/trials/live && exit $$computed
EXAMPLES ?= 1

lint: $(VENV)/.done
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

# What builds and checks packages has an environment of its own, as the peers have.
DIST := .venv-dist
$(DIST)/.done: Makefile
	@rm -rf $(DIST)
	@"$(SYSTEM_PYTHON)" -m venv $(DIST)
	@$(DIST)/bin/python -m pip install --quiet --disable-pip-version-check build==1.6.1 twine==7.0.0
	@touch $(DIST)/COLCON_IGNORE $@

dist: $(DIST)/.done
	@rm -rf dist
	@$(DIST)/bin/python -m build --outdir dist . > $(DIST)/log || { cat $(DIST)/log; exit 1; }
	@$(DIST)/bin/twine check --strict dist/*

dist-check: dist
	@PYTHON="$(SYSTEM_PYTHON)" .ci/dist-check

# Apart from the package's own environment: Sphinx reads the code without importing it, and wants an
# older docutils than colcon has.
DOCS := .venv-docs
$(DOCS)/.done: docs/requirements.lock
	@test -n "$(SYSTEM_PYTHON)" || { echo "make: needs Python 3.11 or 3.12 (PYTHON=… to name one)"; exit 2; }
	@echo "$(DOCS): installing docs/requirements.lock, once"
	@rm -rf $(DOCS)
	@"$(SYSTEM_PYTHON)" -m venv $(DOCS)
	@$(DOCS)/bin/python -m pip install --quiet --disable-pip-version-check --no-deps -r docs/requirements.lock
	@touch $(DOCS)/COLCON_IGNORE $@

docs: $(DOCS)/.done
	@$(DOCS)/bin/python -m sphinx -q -W --keep-going -j auto -b html docs out/site -d out/site-doctrees
	@echo "out/site/index.html"

SEEDS ?= 0 12
LAB_SEEDS ?= 0 5
trials: $(VENV)/.done
	@$(MAKE) --no-print-directory test-long EXAMPLES=20
	PYTHONPATH=. $(ENVIRONMENT) $(BIN)/python benchmark/trials.py --seeds $(SEEDS) --jobs 2
	PYTHONPATH=. $(ENVIRONMENT) $(BIN)/python benchmark/lab_trials.py --seeds $(LAB_SEEDS) --jobs 2

trials-real: $(VENV)/.done
	PYTHONPATH=. $(ENVIRONMENT) $(BIN)/python benchmark/real_trials.py --jobs 2

sensitivity: $(VENV)/.done
	PYTHONPATH=. $(ENVIRONMENT) $(BIN)/python benchmark/sensitivity.py --jobs 2

story: $(VENV)/.done
	PYTHONPATH=. $(ENVIRONMENT) $(BIN)/python docs/real_data/story.py
	PYTHONPATH=. $(ENVIRONMENT) $(BIN)/python docs/psm/story.py

# The peers have an environment of their own: nothing of it is a dependency of the package.
PEERS := .venv-peers
$(PEERS)/.done: benchmark/peers/requirements.lock
	@test -n "$(SYSTEM_PYTHON)" || { echo "make: needs Python 3.11 or 3.12 (PYTHON=… to name one)"; exit 2; }
	@echo "$(PEERS): installing benchmark/peers/requirements.lock, once; takes some minutes"
	@rm -rf $(PEERS)
	@"$(SYSTEM_PYTHON)" -m venv $(PEERS)
	@$(PEERS)/bin/python -m pip install --quiet --disable-pip-version-check --no-deps -r benchmark/peers/requirements.lock
	@touch $(PEERS)/COLCON_IGNORE $@

peers: $(VENV)/.done $(PEERS)/.done
	@mkdir -p out/bench
	PYTHONPATH=. $(ENVIRONMENT) $(BIN)/python benchmark/peers/run.py $(if $(QUICK),--quick,--json out/bench/peers.json)

# Each prints a table and leaves its figures in out/bench; the last line names what missed a target.
BENCHMARKS ?= torque startup latency faults attacks starts passivity simulator gravity_regressor identify supervisor_properties fuzz soak
bench: $(VENV)/.done
	@mkdir -p out/bench; missed=""; \
	for name in $(BENCHMARKS); do \
	  echo; echo "--- $$name"; \
	  case $$name in supervisor_properties) flags="--cases 1500";; fuzz) flags="--cases 300";; \
	    soak) flags="--minutes $(MINUTES)";; passivity) flags="--quick";; *) flags="";; esac; \
	  PYTHONPATH=. $(ENVIRONMENT) $(BIN)/python benchmark/$$name.py $$flags \
	    --json out/bench/$$name.json || missed="$$missed $$name"; \
	done; \
	echo; echo "targets missed:$${missed:- none}"; test -z "$$missed"
MINUTES ?= 2

lock:
	rm -rf $(VENV)-lock
	"$(SYSTEM_PYTHON)" -m venv $(VENV)-lock
	$(VENV)-lock/bin/python -m pip install --quiet -r requirements.in
	{ head -1 requirements.lock; $(VENV)-lock/bin/python -m pip freeze --all | $(OF_THE_INDEX); } > requirements.new
	mv requirements.new requirements.lock
	rm -rf $(VENV)-lock

clean:
	rm -rf build dist install log out $(VENV) $(VENV)-lock $(PEERS) $(DIST) $(DOCS) docs/api
