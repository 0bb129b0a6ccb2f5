"""Whether views see enough points, well enough spread, to determine their poses."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pocketgs.geometry.camera import Camera
from pocketgs.prior.features.observations import Observations

CELLS = 4
"""Cells along each side of an image, to tell whether its points are spread out."""

MIN_CELLS = 5
"""Minimum number of cells with points."""


def well_supported(cameras: Sequence[Camera], observations: Observations, fewest: int) -> np.ndarray:
    """(F,) bool: views with at least `fewest` observations, in at least `MIN_CELLS` cells of their images.

    Args:
        cameras: of F views.
        observations: in these views.
        fewest: minimum number of observations of a view.
    """
    sizes = np.array([(camera.width, camera.height) for camera in cameras])[observations.frame]
    across, down = np.clip(observations.pixels / sizes * CELLS, 0, CELLS - 1).astype(np.int64).T
    occupied = np.zeros((len(cameras), CELLS**2), bool)
    occupied[observations.frame, CELLS * down + across] = True
    counts = np.bincount(observations.frame, minlength=len(cameras))
    return (counts >= fewest) & (occupied.sum(axis=1) >= MIN_CELLS)
