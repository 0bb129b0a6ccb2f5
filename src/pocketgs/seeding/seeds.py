"""Seeds: a disc or a ball at every point of a cloud."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from scipy.spatial.transform import Rotation

from pocketgs.errors import PocketGSError
from pocketgs.scene.gaussians import SH_COEFFICIENTS, SH_DC, Gaussians
from pocketgs.scene.point_cloud import PointCloud
from pocketgs.seeding.cpu import CpuSearch
from pocketgs.seeding.neighbourhoods import MIN_POINTS, Neighbourhoods, NeighbourSearch

THICKNESS = 0.3
"""Scale of a disc along the surface normal, relative to that along the surface."""


class Seeding(Protocol):
    """A way of seeding."""

    def __call__(
        self,
        points: PointCloud,
        opacity: float,
        sh_degree: int,
        size: float = 1.0,
        search: NeighbourSearch | None = None,
    ) -> Gaussians:
        """See `seed_discs`."""


def seed_discs(
    points: PointCloud, opacity: float, sh_degree: int, size: float = 1.0, search: NeighbourSearch | None = None
) -> Gaussians:
    """Place a disc at every point, tangent to the local surface.

    The surface is the plane through the point's 16 nearest neighbours, see `Neighbourhoods`; its normal points to the
    side that the point was seen from. The disc's scales are s_t along the surface, the mean distance to the three
    nearest neighbours, and 0.3 s_t along the normal, its z-axis. Neighbours that coincide count once.

    Args:
        points: N >= 4 points.
        opacity: initial opacity in (0, 1).
        sh_degree: degree of the spherical harmonics; those above 0 start at zero.
        size: factor on the scales.
        search: finds the neighbours; None for the CPU.

    Raises:
        PocketGSError: there are too few distinct points, or one is not finite.
    """
    around = _neighbourhoods(points, search)
    normals = around.normals
    if points.directions is not None:
        away = np.sum(normals * points.directions, axis=1) < 0
        normals = np.where(away[:, None], -normals, normals)
    frames = np.stack([around.tangents, np.cross(normals, around.tangents), normals], axis=2)
    quaternions = Rotation.from_matrix(frames).as_quat()[:, [3, 0, 1, 2]]
    scales = size * _sizes(around)[:, None] * np.array([1.0, 1.0, THICKNESS])
    return _seeds(points, np.log(scales), quaternions, opacity, sh_degree)


def seed_balls(
    points: PointCloud, opacity: float, sh_degree: int, size: float = 1.0, search: NeighbourSearch | None = None
) -> Gaussians:
    """Place a ball at every point, of the size of the mean distance to its three nearest neighbours (3DGS, section 4).

    Arguments and errors as those of `seed_discs`.
    """
    sizes = _sizes(_neighbourhoods(points, search))
    quaternions = np.tile([1.0, 0.0, 0.0, 0.0], (len(points), 1))
    return _seeds(points, np.repeat(np.log(size * sizes)[:, None], 3, axis=1), quaternions, opacity, sh_degree)


SEEDINGS: dict[str, Seeding] = {"discs": seed_discs, "balls": seed_balls}


def _neighbourhoods(points: PointCloud, search: NeighbourSearch | None) -> Neighbourhoods:
    """The neighbourhood of every point among points elsewhere: coincident ones say nothing of the surface."""
    if not np.isfinite(points.positions).all():
        raise PocketGSError("seeding: points to start from have coordinates that are not finite")
    _, first, members = np.unique(points.positions, axis=0, return_index=True, return_inverse=True)
    kept = np.sort(first)
    if len(kept) < MIN_POINTS:
        found = f"{len(points)} points to start from, {len(kept)} of them distinct"
        raise PocketGSError(f"seeding: {found}, expected at least {MIN_POINTS}")
    around = (search or CpuSearch()).around(points.positions[kept])
    rows = np.searchsorted(kept, first[members.reshape(-1)])
    return Neighbourhoods(around.spacing[rows], around.normals[rows], around.tangents[rows])


def _sizes(around: Neighbourhoods) -> np.ndarray:
    """(N,) the spacings, but for points that nearly coincide, which would give Gaussians of size zero."""
    return np.maximum(around.spacing, 0.01 * np.median(around.spacing) + np.finfo(np.float32).tiny)


def _seeds(
    points: PointCloud, log_scales: np.ndarray, quaternions: np.ndarray, opacity: float, sh_degree: int
) -> Gaussians:
    sh = np.zeros((len(points), SH_COEFFICIENTS[sh_degree], 3), np.float32)
    sh[:, 0] = (points.colours - 0.5) / SH_DC
    return Gaussians(
        points.positions, log_scales, quaternions, np.full(len(points), np.log(opacity / (1.0 - opacity))), sh
    )
