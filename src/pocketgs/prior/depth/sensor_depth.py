"""Filling depth maps with the depth of a phone's sensor where matching is unsure."""

from __future__ import annotations

import numpy as np

from pocketgs.capture.capture import Frame
from pocketgs.prior.depth.sweep import DepthMap

WEAK_MARGIN = 0.04
"""Matched depths with a smaller margin are replaced by measured ones, for example on white walls."""

SURE_MARGIN = 0.1
MIN_PIXELS = 100


def completed(found: DepthMap, keyframe: Frame) -> DepthMap:
    """The depth map with measured depths where matching is unsure.

    Measured depths are first scaled to the confident matched ones: pose refinement may have changed the scale slightly.

    Args:
        found: from matching.
        keyframe: the frame, with or without the sensor's depth.
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
