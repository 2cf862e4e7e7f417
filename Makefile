# Two commands: `make session` and `make test`. Both set everything up first.
PYTHON_ENV := .venv/bin/python
SESSION ?=

# Numba does not notice that a kernel's callee changed: the cache belongs to one state of the code.
export NUMBA_CACHE_DIR := $(CURDIR)/.cache/numba/$(shell LC_ALL=C sh -c 'cat src/*/*/*.py src/*/*/*/*.py' 2>/dev/null | sha1sum | cut -c1-12)
# Small matrices run slower on many threads, and the control loop needs a core.
export OPENBLAS_NUM_THREADS ?= 1
export OMP_NUM_THREADS ?= 1
# Images of containers often set it: each of the many processes would compile the sources anew.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: setup venv kernels session test check lint bench soak calibrate-diagnosis clean reference docs-figures screenshots tutorials site

setup: kernels

venv:
	@bash tools/setup.sh

# What Numba compiles, before anything waits for it.
kernels: venv
	@$(PYTHON_ENV) -m stage_bringup.kernels

session: kernels
	@PATH="$(CURDIR)/.venv/bin:$$PATH" $(PYTHON_ENV) -m stage_bringup.session $(SESSION)

# Graphs wait while others compute: three processes on two cores. A file stays in one process; of
# processes that a hanging test ends, one is replaced.
SIDE_BY_SIDE := -n 3 --dist loadfile --no-loadscope-reorder --max-worker-restart=1
test: kernels
	$(PYTHON_ENV) -m pytest -q $(SIDE_BY_SIDE) $(PYTEST)

# What can be said in under a minute: format, lint, types of what changed, structure and docs.
CHANGED := $(shell git diff --name-only --diff-filter=d main -- 'src/*/*/*.py' 2>/dev/null)
check: venv
	.venv/bin/ruff check .
	.venv/bin/ruff format --check .
	$(if $(CHANGED),.venv/bin/mypy $(CHANGED))
	$(PYTHON_ENV) -m pytest -q tests/test_structure.py tests/test_docs.py

lint: venv
	.venv/bin/ruff check .
	.venv/bin/ruff format --check .
	.venv/bin/mypy $(patsubst %/__init__.py,%,$(wildcard src/*/*/__init__.py)) \
		benchmarks/*/*.py benchmarks/*.py tools/*.py

bench: venv
	@PATH="$(CURDIR)/.venv/bin:$$PATH" bash benchmarks/run.sh

# Probabilities and intervals of the diagnosis, fitted and measured on simulated sessions.
SESSIONS ?= 300
calibrate-diagnosis: kernels
	$(PYTHON_ENV) -m benchmarks.calibrate --sessions $(SESSIONS)

# All tutorials beside their pages, then what takes hours: its results go into
# docs/results/soak.md.
MINUTES ?= 60
soak: kernels
	TUTORIALS=all nice -n 15 $(PYTHON_ENV) -m pytest -q tests/test_tutorials.py
	nice -n 15 $(PYTHON_ENV) benchmarks/soak.py --minutes $(MINUTES)

reference: venv
	$(PYTHON_ENV) -m stage_bringup.reference docs/reference/reference.md

# Figures of notebooks, of cheap commands and of the newest session in bags/, into README and docs.
docs-figures: tutorials
	$(PYTHON_ENV) tools/printed.py
	$(PYTHON_ENV) tools/docs_figures.py

# Chromium draws the pages of the newest session and the live view, into docs/images.
screenshots: kernels
	$(PYTHON_ENV) tools/screenshots.py

# Runs the notebooks and writes their pages and pictures.
tutorials: kernels
	$(PYTHON_ENV) tools/notebooks.py

# The documentation as a site in build/site, with links checked.
site: venv
	@bash tools/site/build.sh

clean:
	rm -rf .venv .cache .ruff_cache .mypy_cache .hypothesis .pytest_cache ros_ws/build ros_ws/install ros_ws/log
	find src tests benchmarks -name __pycache__ -prune -exec rm -rf {} +
