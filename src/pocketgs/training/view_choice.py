"""The view of each training step."""

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
