"""Strategies: control of the number of Gaussians during training. One file per strategy, listed in `choose.py`."""
