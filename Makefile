# Every target sets up its own environment in .venv first; see tools/bootstrap.py for what that needs (only Python).

PYTHON ?= python3

# Tests use all cores only part of the time: four processes keep two cores busy. Tests of one file run in the same process,
# because they share fixtures. In the folders' order the longest files come in the middle, so that processes end together;
# by the number of tests they would come last.
SIDE_BY_SIDE = -n 4 --dist loadfile --no-loadscope-reorder

# Tests start hundreds of Python processes. Where this variable forbids keeping bytecode, each compiles all modules.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo test test-fast system-packages environment lint kernels lint-and-kernels bench clean

# Capture and train a small built-in scene.
demo:
	@$(PYTHON) tools/bootstrap.py
	.venv/bin/pocketgs demo

# Processes side by side share the cores: threads of OpenBLAS that wait for work would take them from each other.
test test-fast: export OPENBLAS_NUM_THREADS = 1

# All checks before a merge, with runs on real data. Continuous integration calls this target. Missing system packages are
# installed if that is allowed; otherwise the tests that need them are skipped, and pytest reports it. PyTorch and gsplat's
# reference keep memory that the tests of budgets would count, so their tests run last, in separate processes.
test: system-packages lint-and-kernels
	.venv/bin/python -m pytest $(SIDE_BY_SIDE) --ignore tests/pytorch
	.venv/bin/python -m pytest $(SIDE_BY_SIDE) tests/pytorch

# The same checks without the runs on real data.
test-fast: system-packages lint-and-kernels
	.venv/bin/python -m pytest -m "not slow" $(SIDE_BY_SIDE) --ignore tests/pytorch
	.venv/bin/python -m pytest -m "not slow" $(SIDE_BY_SIDE) tests/pytorch

system-packages:
	@$(PYTHON) tools/system_packages.py

environment:
	@$(PYTHON) tools/bootstrap.py dev

lint: environment
	.venv/bin/python -m ruff check
	.venv/bin/python -m ruff format --check
	.venv/bin/python -m mypy

# Compiled once, rather than by each process that runs tests.
kernels: environment
	.venv/bin/python tests/compile_kernels.py

# Side by side, since type checking uses one core.
lint-and-kernels: environment
	@$(MAKE) --no-print-directory -j 2 lint kernels

# The tables of results, on the captures in the folder that POCKETGS_DATA names and on the demo.
bench:
	@$(PYTHON) tools/bootstrap.py bench
	.venv/bin/pocketgs bench

clean:
	rm -rf .venv build dist src/pocketgs.egg-info .pytest_cache .ruff_cache .mypy_cache .hypothesis
	find . -name __pycache__ -prune -exec rm -rf {} +
