"""What the host writes to the GPU for the comparison of depth maps."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from pocketgs.gpu.sizes import Symbols
from pocketgs.prior.depth.consistency import SweptViews, farthest_confirmed


def comparison_numbers(views: SweptViews, view: int) -> dict[str, int]:
    """The numbers that `describe_comparison` names."""
    count, image_height, image_width = views.depths.shape
    height, width = (int(side) for side in views.sizes[view])
    return {
        "width": width,
        "height": height,
        "image_width": image_width,
        "image_height": image_height,
        "views": count,
    }


def comparison_fields(
    views: SweptViews, view: int, given: Symbols, tolerance: float, least: float
) -> Mapping[str, ArrayLike]:
    """The fields of the uniform buffer `comparison`."""
    fx, fy, cx, cy = views.intrinsics[view]
    thresholds = {"tolerance": tolerance, "least": least}
    return {**given, "focal": (fx, fy), "principal": (cx, cy), "view": view, **thresholds}


def other_records(views: SweptViews, view: int) -> np.ndarray:
    """(K, 5, 4) float32, as `agreement.wgsl` reads them.

    Transforms between views are put together in float64: far from the world's origin, single precision would not hold
    the difference of two positions.
    """
    records = np.zeros((len(views.depths), 5, 4), np.float32)
    turns = views.rotations @ views.rotations[view].T
    records[:, :3, :3], records[:, :3, 3] = turns, views.translations - turns @ views.translations[view]
    records[:, 3] = views.intrinsics
    records[:, 4, 0], records[:, 4, 1] = views.sizes[:, 1], views.sizes[:, 0]
    records[:, 4, 2] = np.maximum(views.steps, views.steps[view])
    # A shader's compiler may assume that there are no infinite numbers.
    records[:, 4, 3] = np.minimum(farthest_confirmed(views, view), np.finfo(np.float32).max)
    return records
