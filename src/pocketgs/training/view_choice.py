"""Choice and order of views."""

from __future__ import annotations

import numpy as np


def view_of_step(step: int, views: int, seed: int) -> int:
    """Index of the view of a training step: every view once per epoch, in an order given by seed and epoch.

    Args:
        step: number of steps taken before.
        views: number of views.
        seed: random seed of the order.
    """
    epoch, place = divmod(step, views)
    return int(np.random.default_rng((seed, epoch)).permutation(views)[place])


def evenly_chosen(views: int, most: int) -> np.ndarray:
    """Indices of at most `most` views, ascending and evenly spaced from the first to the last."""
    return np.unique(np.linspace(0, views - 1, min(views, most)).round().astype(int))
