"""Drawing orders of the visible Gaussians: by depth, or in memory order."""

from __future__ import annotations

import numpy as np

from pocketgs.splat.constants import CULLED
from pocketgs.splat.cpu.layout import CLUSTER
from pocketgs.system.compile import kernel

_DIGIT_BITS = 11
_DIGITS = 1 << _DIGIT_BITS


@kernel
def sort_by_depth(
    depth_keys: np.ndarray, clusters: np.ndarray, visible: np.ndarray, order: np.ndarray, scratch: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Radix sort with three 11-bit digits; returns the visible Gaussians in two orders.

    Args:
        depth_keys: (N,) uint32 from `project`.
        clusters: (M,) int32 ascending, the projected clusters.
        visible: (N,) int32, overwritten.
        order: (N,) int32, overwritten.
        scratch: (N,) int32, overwritten.

    Returns:
        (V,) int32 indices, part of `visible`: in memory order.
        (V,) int32 indices, part of `order`: by depth, nearest first, equal depths by index.
    """
    count = 0
    histograms = np.zeros((3, _DIGITS), np.int32)
    for cluster in clusters:
        for i in range(cluster * CLUSTER, min((cluster + 1) * CLUSTER, len(depth_keys))):
            key = depth_keys[i]
            if key != CULLED:
                visible[count] = i
                count += 1
                for digit in range(3):
                    histograms[digit, (key >> np.uint32(_DIGIT_BITS * digit)) & np.uint32(_DIGITS - 1)] += 1
    source, target, other = visible[:count], order[:count], scratch[:count]
    for digit in range(3):
        position = 0
        starts = histograms[digit]
        for value in range(_DIGITS):
            number = starts[value]
            starts[value] = position
            position += number
        for i in source:
            value = (depth_keys[i] >> np.uint32(_DIGIT_BITS * digit)) & np.uint32(_DIGITS - 1)
            target[starts[value]] = i
            starts[value] += 1
        source, target, other = target, other, target
    return visible[:count], source


@kernel
def in_memory_order(
    depth_keys: np.ndarray, clusters: np.ndarray, visible: np.ndarray, order: np.ndarray, scratch: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The visible Gaussians in memory order, twice; arguments and results as those of `sort_by_depth`."""
    count = 0
    for cluster in clusters:
        for i in range(cluster * CLUSTER, min((cluster + 1) * CLUSTER, len(depth_keys))):
            if depth_keys[i] != CULLED:
                visible[count] = i
                count += 1
    return visible[:count], visible[:count]
