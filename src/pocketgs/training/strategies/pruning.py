"""Pruning that leaves something to train and to save."""

from __future__ import annotations

import numpy as np


def at_least_one(is_kept: np.ndarray, means: np.ndarray, opacities: np.ndarray) -> np.ndarray:
    """(N,) bool, which Gaussians to keep: those given, or the most opaque one if there are none.

    Args:
        is_kept: (N,) bool.
        means: (N, 3) centres; those with NaN or infinity come last.
        opacities: (N,), may be NaN.
    """
    if is_kept.any():
        return is_kept
    worth = np.where(np.isfinite(means).all(axis=1), np.nan_to_num(opacities, nan=0.0), -1.0)
    return np.arange(len(is_kept)) == worth.argmax()
