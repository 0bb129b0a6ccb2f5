"""Order along a curve that keeps neighbours in space together."""

from __future__ import annotations

import numpy as np

BITS = 21
"""Of each coordinate; three of them fill a 64-bit code."""


def morton_order(points: np.ndarray) -> np.ndarray:
    """(N,) indices that sort (N, 3) finite points by the interleaved bits of x (lowest), y and z."""
    low = points.min(axis=0).astype(np.float64)
    extent = points.max(axis=0) - low
    cells = (points - low) / np.where(extent > 0, extent, 1.0) * (2**BITS - 1)
    codes = sum(_spread(cells[:, axis].astype(np.uint64)) << np.uint64(axis) for axis in range(3))
    return np.argsort(codes, kind="stable")


def _spread(numbers: np.ndarray) -> np.ndarray:
    """The numbers' bits with two zeros before each."""
    spread = numbers
    for shift, mask in (
        (32, 0x001F00000000FFFF),
        (16, 0x001F0000FF0000FF),
        (8, 0x100F00F00F00F00F),
        (4, 0x10C30C30C30C30C3),
        (2, 0x1249249249249249),
    ):
        spread = (spread | spread << np.uint64(shift)) & np.uint64(mask)
    return spread
