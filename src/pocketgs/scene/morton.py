"""Morton order: Gaussians that are neighbours in space become neighbours in memory."""

from __future__ import annotations

import numpy as np

BITS = 21
"""Bits per coordinate; three coordinates fill a 64-bit code."""


def morton_order(means: np.ndarray) -> np.ndarray:
    """(N,) indices that sort Gaussians along a Morton curve; equal positions keep their order.

    Engines skip whole blocks of Gaussians outside the view: `scene.select(morton_order(scene.means))` makes the blocks
    compact.

    Args:
        means: (N, 3). Non-finite ones come last.
    """
    finite = np.isfinite(means).all(axis=1)
    if not finite.any():
        return np.arange(len(means))
    # A few outliers must not use up the bits of all others.
    low, high = np.quantile(means[finite], [0.01, 0.99], axis=0)
    extent = max(float((high - low).max()), np.finfo(np.float32).tiny)
    with np.errstate(all="ignore"):
        cells = np.clip((means.astype(np.float64) - (low - 0.5 * extent)) / (2.0 * extent), 0.0, 1.0)
    cells = np.where(finite[:, None], cells, 1.0) * (2**BITS - 1)
    x, y, z = (_spread(cells[:, axis].astype(np.uint64)) for axis in range(3))
    codes = x | y << np.uint64(1) | z << np.uint64(2)
    codes[~finite] = np.iinfo(np.uint64).max
    return np.argsort(codes, kind="stable")


def _spread(numbers: np.ndarray) -> np.ndarray:
    """Insert two zeros between the bits of numbers of up to BITS bits."""
    for shift, mask in (
        (32, 0x1F00000000FFFF),
        (16, 0x1F0000FF0000FF),
        (8, 0x100F00F00F00F00F),
        (4, 0x10C30C30C30C30C3),
        (2, 0x1249249249249249),
    ):
        numbers = (numbers | numbers << np.uint64(shift)) & np.uint64(mask)
    return numbers
