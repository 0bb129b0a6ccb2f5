"""The near plane, relative to the size of the scene."""

from __future__ import annotations

import math

import numpy as np

from pocketgs.splat.constants import NEAR

SAMPLES = 4096


def near_plane(means: np.ndarray) -> float:
    """Minimum depth, in scene units, of the centre of a drawn Gaussian. The viewer's `nearPlane` computes the same.

    It is NEAR times the median distance of the Gaussians from their median position, rounded to a power of two, so that
    it does not change with every step.

    Args:
        means: (N, 3). Non-finite ones are ignored. If all others coincide, or there are none, the scene's size counts
            as 1.
    """
    sample = means[:: max(1, math.ceil(len(means) / SAMPLES))].astype(np.float64)
    sample = sample[np.isfinite(sample).all(axis=1)]
    if len(sample) == 0:
        return NEAR
    offsets = np.abs(sample - _middle(sample)).max(axis=1)
    extent = float(_middle(offsets[:, None])[0])
    return NEAR * 2.0 ** round(math.log2(extent)) if extent > 0 else NEAR


def _middle(rows: np.ndarray) -> np.ndarray:
    """The upper median of each column."""
    return np.sort(rows, axis=0)[len(rows) // 2]
