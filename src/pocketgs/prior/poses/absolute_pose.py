"""The absolute pose of one camera, from known points and without an initial pose."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from pocketgs.geometry.camera import Camera
from pocketgs.prior.bundle.adjustment import BundleSettings, adjust_pose
from pocketgs.prior.features.observations import Observations
from pocketgs.prior.features.tracks import reprojection_errors
from pocketgs.prior.poses.support import well_supported

MIN_OBSERVATIONS = 24
"""Minimum number of observations that must agree on a pose."""

CONFIDENCE, TRIALS = 0.9999, 2000


def pose_from_points(camera: Camera, points: np.ndarray, pixels: np.ndarray, tolerance: float) -> Camera | None:
    """The camera at the pose that most observations agree on, or None if too few do.

    RANSAC over three points at a time (Gao et al. 2003, in OpenCV), then least squares over all that agree.

    Args:
        camera: with its intrinsics.
        points: (M, 3) in the world.
        pixels: (M, 2) possible observations, including wrong ones.
        tolerance: maximum error of an agreeing observation in pixels.
    """
    if len(points) < MIN_OBSERVATIONS:
        return None
    # OpenCV's RANSAC computes in float32: points are centred and scaled down first.
    middle, size = points.mean(axis=0), max(float(np.abs(points - points.mean(axis=0)).max()), 1e-300)
    try:
        found, turn, offset, _ = cv2.solvePnPRansac(
            (points - middle) / size,
            pixels,
            camera.intrinsic_matrix,
            None,
            iterationsCount=TRIALS,
            reprojectionError=tolerance,
            confidence=CONFIDENCE,
            flags=cv2.SOLVEPNP_AP3P,
        )
    except cv2.error:  # a degenerate sample
        return None
    if not found:
        return None
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_rotvec(np.ravel(turn)).as_matrix()
    pose[:3, 3] = np.ravel(offset) * size - pose[:3, :3] @ middle
    placed = replace(camera, world_to_camera=pose)
    for _ in range(2):
        near = agreeing(placed, points, pixels, tolerance)
        if not _enough(camera, pixels[near]):
            return None
        placed = adjust_pose(placed, points[near], pixels[near], BundleSettings(huber=tolerance / 2)).camera
    return placed if _enough(camera, pixels[agreeing(placed, points, pixels, tolerance)]) else None


def agreeing(camera: Camera, points: np.ndarray, pixels: np.ndarray, tolerance: float) -> np.ndarray:
    """(M,) bool: pixels within the tolerance of the points' projections."""
    return reprojection_errors([camera], points, Observations.in_one_view(pixels)) < tolerance


def _enough(camera: Camera, pixels: np.ndarray) -> bool:
    """Whether observations at these pixels are enough, and well enough spread, for a pose."""
    return bool(well_supported([camera], Observations.in_one_view(pixels), MIN_OBSERVATIONS)[0])
