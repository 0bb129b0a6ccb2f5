"""Each Gaussian's contribution to a view's error: Σ over pixels of α T |rendered - photograph|.

The backward pass sums α T times the gradient of a pixel's colour; here the error replaces that gradient.
"""

from __future__ import annotations

import numpy as np

from pocketgs.splat.cpu.bin import TileLists
from pocketgs.splat.cpu.lanes import LANES
from pocketgs.splat.cpu.layout import SLOTS_COUNT, SLOTS_FIRST
from pocketgs.splat.cpu.tile_sums import SUM_RED


def write_error(image: np.ndarray, photo: np.ndarray, mask: np.ndarray, d_image: np.ndarray) -> None:
    """Write the mean error over channels to the first plane, and zeros to the others.

    Args:
        image: (3, H, W) float32.
        photo: (3, H, W) uint8.
        mask: (H, W) bool, or (0, 0) for none; the error is 0 outside it.
        d_image: (3, H, W) float32, written.
    """
    d_image[1:] = 0.0
    with np.errstate(invalid="ignore"):
        np.abs(image - photo * np.float32(1.0 / 255.0)).mean(axis=0, out=d_image[0])
    if mask.size:
        d_image[0][~mask] = 0.0


def error_sums(visible: np.ndarray, lists: TileLists, intersection_sums: np.ndarray) -> np.ndarray:
    """(V,) float64: the sum of each of the (V,) visible Gaussians, from the output of `rasterize_backward`."""
    by_slot = intersection_sums[: len(lists.intersections) * LANES].reshape(-1, LANES)[:, SUM_RED]
    up_to = np.zeros(len(by_slot) + 1)
    np.cumsum(by_slot, dtype=np.float64, out=up_to[1:])
    first = lists.slots[visible, SLOTS_FIRST]
    return up_to[first + lists.slots[visible, SLOTS_COUNT]] - up_to[first]
