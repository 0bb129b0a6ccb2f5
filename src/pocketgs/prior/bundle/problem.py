"""Input of bundle adjustment: checks, and conversion to its own order."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from pocketgs.errors import PocketGSError, listed
from pocketgs.geometry.camera import Camera
from pocketgs.prior.bundle.reprojection import Estimate, Sightings
from pocketgs.prior.features.observations import Observations

MIN_POINTS = 3
"""Minimum number of points that determine a pose."""


def check(
    cameras: Sequence[Camera],
    points: np.ndarray,
    observations: Observations,
    fewest_views: int,
    poses_known: bool,
) -> None:
    """Check that arrays fit together and determine the unknowns.

    Args:
        cameras: F of them.
        points: (N, 3).
        observations: where points were observed.
        fewest_views: minimum number of cameras per point.
        poses_known: whether there is a prior on every pose.

    Raises:
        PocketGSError: they do not.
    """
    frame, point, pixels = observations.frame, observations.point, observations.pixels
    count = len(frame)
    if points.ndim != 2 or points.shape[1:] != (3,) or not np.all(np.isfinite(points)):
        raise PocketGSError(f"bundle: points of shape {points.shape}, expected (N, 3) finite numbers")
    if frame.shape != (count,) or point.shape != (count,) or pixels.shape != (count, 2):
        shapes = f"{frame.shape}, {point.shape}, {pixels.shape}"
        raise PocketGSError(f"bundle: frame, point, pixels of shapes {shapes}, expected (M,), (M,), (M, 2)")
    if count == 0:
        raise PocketGSError("bundle: no observations")
    if not np.all(np.isfinite(pixels)):
        raise PocketGSError(f"bundle: {np.sum(~np.isfinite(pixels).all(axis=1))} observed pixels are not finite")
    for name, indices, end in (("frame", frame, len(cameras)), ("point", point, len(points))):
        if indices.min() < 0 or indices.max() >= end:
            raise PocketGSError(f"bundle: {name} from {indices.min()} to {indices.max()}, expected 0 to {end - 1}")
    pairs = np.unique(np.stack([point, frame]), axis=1)
    views = np.bincount(pairs[0], minlength=len(points))
    if views.min() < fewest_views:
        lonely = np.flatnonzero(views < fewest_views)
        named = listed([str(index) for index in lonely], 10)
        raise PocketGSError(f"bundle: {len(lonely)} points seen by fewer than {fewest_views} cameras: {named}")
    seen = np.bincount(pairs[1], minlength=len(cameras))
    if not poses_known and seen.min() < MIN_POINTS:
        raise PocketGSError(
            f"bundle: camera {seen.argmin()} sees {seen.min()} points, expected {MIN_POINTS} or a prior on its pose"
        )


def by_point(cameras: Sequence[Camera], points: int, observations: Observations, order: np.ndarray) -> Sightings:
    """The observations, sorted by point."""
    point = np.asarray(observations.point, np.int64)[order]
    return Sightings(
        intrinsics=np.array([[camera.fx, camera.fy, camera.cx, camera.cy] for camera in cameras], np.float64),
        frame=np.asarray(observations.frame, np.int64)[order],
        point=point,
        starts=np.searchsorted(point, np.arange(points + 1)).astype(np.int64),
        pixels=np.asarray(observations.pixels, np.float64)[order],
    )


def first_estimate(cameras: Sequence[Camera], points: np.ndarray) -> Estimate:
    """The starting point. Poses from files are rotations only up to rounding; they are orthonormalised here."""
    rotations = Rotation.from_matrix(np.array([camera.world_to_camera[:3, :3] for camera in cameras])).as_matrix()
    centres = np.array([camera.centre for camera in cameras])
    return Estimate(rotations, centres, np.array(points, np.float64))
