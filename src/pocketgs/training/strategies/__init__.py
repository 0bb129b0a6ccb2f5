"""Strategies: how the number of Gaussians changes over a run. One file per strategy, chosen in `choose.py`."""
