"""Depth that a phone's sensor measured, where matching photographs does not tell."""

from __future__ import annotations

import numpy as np

from pocketgs.capture.capture import Frame
from pocketgs.prior.sweep import DepthMap

WEAK_MARGIN = 0.04
"""A matched depth that wins by less gives way to a measured one: the wall is white, and the sensor sees it."""

SURE_MARGIN = 0.1
MIN_PIXELS = 100


def completed(found: DepthMap, keyframe: Frame) -> DepthMap:
    """The depth map with measured depths where matching is unsure.

    Measured depths are first scaled to those that matching is sure of: refined poses may have changed the scene's scale
    a little.

    Args:
        found: by matching.
        keyframe: the frame, with the sensor's depth or without.
    """
    if keyframe.depth is None:
        return found
    measured = keyframe.depth if keyframe.usable is None else np.where(keyframe.usable, keyframe.depth, 0)
    sure = (found.depth > 0) & (measured > 0) & (found.margin >= SURE_MARGIN)
    scale = np.median(found.depth[sure] / measured[sure]) if np.count_nonzero(sure) >= MIN_PIXELS else 1.0
    unsure = (measured > 0) & ((found.depth == 0) | (found.margin < WEAK_MARGIN))
    return DepthMap(
        np.where(unsure, measured * np.float32(scale), found.depth),
        np.where(unsure, np.float32(SURE_MARGIN), found.margin),
        found.step,
    )
