"""How near to a camera a Gaussian may be: in proportion to the scene, whatever its unit of length."""

from __future__ import annotations

import math

import numpy as np

from pocketgs.splat.constants import NEAR

SAMPLES = 4096


def near_plane(means: np.ndarray) -> float:
    """Least depth, in scene units, of the centre of a Gaussian that is drawn; the twin of `nearPlane` in the viewer.

    It is NEAR times how far the middle Gaussian lies from the middle of them all, rounded to a power of two, so that it
    does not move with every step that Gaussians make.

    Args:
        means: (N, 3). Those that are not finite do not count; where the others lie in one place, or there are none, the
            scene counts as one unit wide.
    """
    sample = means[:: max(1, math.ceil(len(means) / SAMPLES))].astype(np.float64)
    sample = sample[np.isfinite(sample).all(axis=1)]
    if len(sample) == 0:
        return NEAR
    offsets = np.abs(sample - _middle(sample)).max(axis=1)
    extent = float(_middle(offsets[:, None])[0])
    return NEAR * 2.0 ** round(math.log2(extent)) if extent > 0 else NEAR


def _middle(rows: np.ndarray) -> np.ndarray:
    """The middle of each column, one of its numbers."""
    return np.sort(rows, axis=0)[len(rows) // 2]
