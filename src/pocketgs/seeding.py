"""From a point cloud to the Gaussians that training starts with."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from pocketgs.errors import PocketGSError
from pocketgs.gaussians import SH_COEFFICIENTS, SH_DC, Gaussians
from pocketgs.pointcloud import PointCloud

NEIGHBOURS = 3
"""A seed is as large as the mean distance to this many nearest neighbours (3DGS, section 4)."""

FEWEST_POINTS = NEIGHBOURS + 1


def seed_isotropic(points: PointCloud, opacity: float, sh_degree: int, size: float = 1.0) -> Gaussians:
    """A ball at every point, as wide as the mean distance to its three nearest neighbours (3DGS, section 4).

    Args:
        points: N >= 4 points.
        opacity: initial opacity in (0, 1).
        sh_degree: degree of the spherical harmonics; those above 0 start at zero.
        size: factor on the width.

    Raises:
        PocketGSError: there are too few points, or one is not finite.
    """
    count = len(points)
    if count < FEWEST_POINTS:
        raise PocketGSError(f"seeding: {count} points to start from, expected at least {FEWEST_POINTS}")
    if not np.isfinite(points.positions).all():
        raise PocketGSError("seeding: points to start from have coordinates that are not finite")
    tree = cKDTree(points.positions)
    distances, _ = tree.query(points.positions, k=NEIGHBOURS + 1, workers=-1)
    spacing = distances[:, 1:].mean(axis=1)
    # Points on top of each other would give Gaussians of no size.
    spacing = np.maximum(spacing, 0.01 * np.median(spacing) + np.finfo(np.float32).tiny)
    sh = np.zeros((count, SH_COEFFICIENTS[sh_degree], 3), np.float32)
    sh[:, 0] = (points.colours - 0.5) / SH_DC
    return Gaussians(
        points.positions,
        np.repeat(np.log(size * spacing)[:, None], 3, axis=1),
        np.tile([1.0, 0.0, 0.0, 0.0], (count, 1)),
        np.full(count, np.log(opacity / (1.0 - opacity))),
        sh,
    )
