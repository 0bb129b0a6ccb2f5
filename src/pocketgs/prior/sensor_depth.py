"""Depth that a phone's sensor measured, where matching photographs does not tell."""

from __future__ import annotations

import numpy as np

from pocketgs.prior.sweep import DepthMap

WEAK_MARGIN = 0.04
"""A matched depth that wins by less gives way to a measured one: the wall is white, and the sensor sees it."""

SURE_MARGIN = 0.1
FEWEST_PIXELS = 100


def completed(found: DepthMap, measured: np.ndarray | None) -> DepthMap:
    """The depth map with measured depths where matching is unsure.

    Measured depths are first scaled to those that matching is sure of: refined poses may have changed the scene's scale
    a little.

    Args:
        found: by matching.
        measured: (H, W) float32 by a sensor, 0 where unknown, or None.
    """
    if measured is None:
        return found
    sure = (found.depth > 0) & (measured > 0) & (found.margin >= SURE_MARGIN)
    scale = np.median(found.depth[sure] / measured[sure]) if np.count_nonzero(sure) >= FEWEST_PIXELS else 1.0
    unsure = (measured > 0) & ((found.depth == 0) | (found.margin < WEAK_MARGIN))
    return DepthMap(
        np.where(unsure, measured * np.float32(scale), found.depth),
        np.where(unsure, np.float32(SURE_MARGIN), found.margin),
    )
