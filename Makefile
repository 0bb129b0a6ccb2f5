# Every target sets up its own environment in .venv first; see tools/bootstrap.py for what that needs (only Python).

PYTHON ?= python3

# Tests use all cores for a part of their time only, so two processes end in three quarters of one's time. A file's tests
# stay together, for they share what they prepare.
SIDE_BY_SIDE = -n 2 --dist loadfile

.PHONY: demo test test-fast system-packages lint bench clean

# Capture a small built-in scene, train it and show it.
demo:
	@$(PYTHON) tools/bootstrap.py
	.venv/bin/pocketgs demo

# Everything that must hold before a change is merged, runs on real data included: what continuous integration calls.
# What a test needs and the machine lacks is installed where that is allowed; else the test is left out, and said to be.
# PyTorch and gsplat's reference keep memory that tests of budgets would count: they run after the others, in processes of
# their own.
test: system-packages lint
	.venv/bin/python -m pytest $(SIDE_BY_SIDE) --ignore tests/pytorch
	.venv/bin/python -m pytest $(SIDE_BY_SIDE) tests/pytorch

# The same without those runs.
test-fast: system-packages lint
	.venv/bin/python -m pytest -m "not slow" $(SIDE_BY_SIDE) --ignore tests/pytorch
	.venv/bin/python -m pytest -m "not slow" $(SIDE_BY_SIDE) tests/pytorch

system-packages:
	@$(PYTHON) tools/system_packages.py

lint:
	@$(PYTHON) tools/bootstrap.py dev
	.venv/bin/python -m ruff check
	.venv/bin/python -m ruff format --check
	.venv/bin/python -m mypy

# The tables of results, on the captures in the folder that POCKETGS_DATA names and on the demo.
bench:
	@$(PYTHON) tools/bootstrap.py bench
	.venv/bin/pocketgs bench

clean:
	rm -rf .venv build dist src/pocketgs.egg-info .pytest_cache .ruff_cache .mypy_cache .hypothesis
	find . -name __pycache__ -prune -exec rm -rf {} +
