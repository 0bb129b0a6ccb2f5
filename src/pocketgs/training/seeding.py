"""Seeding: initial Gaussians from a point cloud."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from pocketgs.errors import PocketGSError
from pocketgs.scene.gaussians import SH_COEFFICIENTS, SH_DC, Gaussians
from pocketgs.scene.point_cloud import PointCloud
from pocketgs.system.cores import usable_cores

SPACING_NEIGHBOURS = 3
"""A seed's size is the mean distance to this many nearest neighbours (3DGS, section 4)."""

PLANE_NEIGHBOURS = 16
"""The surface at a point is the plane through this many nearest neighbours."""

THICKNESS = 0.3
"""Scale of a disc along the surface normal, relative to that along the surface."""

MIN_POINTS = SPACING_NEIGHBOURS + 1

Seeding = Callable[[PointCloud, float, int, float], Gaussians]
"""Function of points, opacity, SH degree and a factor on the size that returns Gaussians."""


def seed_discs(points: PointCloud, opacity: float, sh_degree: int, size: float = 1.0) -> Gaussians:
    """Place a disc at every point, tangent to the local surface.

    The surface normal is the eigenvector of the smallest eigenvalue of the covariance of the point's 16 nearest
    neighbours, C = 1/K Σ (p_k - p̄)(p_k - p̄)ᵀ, on the side that the point was seen from. The disc's scales are s_t
    along the surface, the mean distance to the three nearest neighbours, and 0.3 s_t along the normal, its z-axis.

    Args:
        points: N >= 4 points.
        opacity: initial opacity in (0, 1).
        sh_degree: degree of the spherical harmonics; those above 0 start at zero.
        size: factor on the scales.

    Raises:
        PocketGSError: there are too few points, or one is not finite.
    """
    neighbours, spacing = _neighbourhoods(points)
    around = points.positions[neighbours].astype(np.float64)
    around -= around.mean(axis=1, keepdims=True)
    _, axes = np.linalg.eigh(around.transpose(0, 2, 1) @ around / neighbours.shape[1])
    normals = axes[:, :, 0]
    if points.directions is not None:
        away = np.sum(normals * points.directions, axis=1) < 0
        normals = np.where(away[:, None], -normals, normals)
    tangents = axes[:, :, 2]
    frames = np.stack([tangents, np.cross(normals, tangents), normals], axis=2)
    quaternions = Rotation.from_matrix(frames).as_quat()[:, [3, 0, 1, 2]]
    scales = size * spacing[:, None] * np.array([1.0, 1.0, THICKNESS])
    return _seeds(points, np.log(scales), quaternions, opacity, sh_degree)


def seed_balls(points: PointCloud, opacity: float, sh_degree: int, size: float = 1.0) -> Gaussians:
    """Place a ball at every point, of the size of the mean distance to its three nearest neighbours (3DGS, section 4).

    Arguments and errors as those of `seed_discs`.
    """
    _, spacing = _neighbourhoods(points)
    quaternions = np.tile([1.0, 0.0, 0.0, 0.0], (len(points), 1))
    return _seeds(points, np.repeat(np.log(size * spacing)[:, None], 3, axis=1), quaternions, opacity, sh_degree)


SEEDINGS: dict[str, Seeding] = {"discs": seed_discs, "balls": seed_balls}


def _neighbourhoods(points: PointCloud) -> tuple[np.ndarray, np.ndarray]:
    """(N, K) indices of each point's neighbours, including itself, and (N,) mean distance to the nearest few."""
    count = len(points)
    if count < MIN_POINTS:
        raise PocketGSError(f"seeding: {count} points to start from, expected at least {MIN_POINTS}")
    if not np.isfinite(points.positions).all():
        raise PocketGSError("seeding: points to start from have coordinates that are not finite")
    tree = cKDTree(points.positions)
    distances, neighbours = tree.query(points.positions, k=min(PLANE_NEIGHBOURS + 1, count), workers=usable_cores())
    spacing = distances[:, 1 : SPACING_NEIGHBOURS + 1].mean(axis=1)
    # Coincident points would give Gaussians of size zero.
    return neighbours, np.maximum(spacing, 0.01 * np.median(spacing) + np.finfo(np.float32).tiny)


def _seeds(
    points: PointCloud, log_scales: np.ndarray, quaternions: np.ndarray, opacity: float, sh_degree: int
) -> Gaussians:
    sh = np.zeros((len(points), SH_COEFFICIENTS[sh_degree], 3), np.float32)
    sh[:, 0] = (points.colours - 0.5) / SH_DC
    return Gaussians(
        points.positions, log_scales, quaternions, np.full(len(points), np.log(opacity / (1.0 - opacity))), sh
    )
