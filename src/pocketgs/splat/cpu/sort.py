"""Sort the visible Gaussians by depth."""

from __future__ import annotations

import numpy as np

from pocketgs.splat.cpu.project import CULLED
from pocketgs.system.compile import kernel

_DIGIT_BITS = 11
_DIGITS = 1 << _DIGIT_BITS


@kernel
def sort_by_depth(depth_keys: np.ndarray, order: np.ndarray, scratch: np.ndarray) -> np.ndarray:
    """Indices of the visible Gaussians, nearest first, equal depths by index: a radix sort of three 11-bit digits.

    Args:
        depth_keys: (N,) uint32 from `project`.
        order: (N,) int32, overwritten.
        scratch: (N,) int32, overwritten.

    Returns:
        (V,) int32, a part of `order` or of `scratch`.
    """
    visible = 0
    histograms = np.zeros((3, _DIGITS), np.int32)
    for i in range(len(depth_keys)):
        key = depth_keys[i]
        if key != CULLED:
            order[visible] = i
            visible += 1
            for digit in range(3):
                histograms[digit, (key >> np.uint32(_DIGIT_BITS * digit)) & np.uint32(_DIGITS - 1)] += 1
    source, target = order[:visible], scratch[:visible]
    for digit in range(3):
        position = 0
        starts = histograms[digit]
        for value in range(_DIGITS):
            count = starts[value]
            starts[value] = position
            position += count
        for rank in range(visible):
            i = source[rank]
            value = (depth_keys[i] >> np.uint32(_DIGIT_BITS * digit)) & np.uint32(_DIGITS - 1)
            target[starts[value]] = i
            starts[value] += 1
        source, target = target, source
    return source
