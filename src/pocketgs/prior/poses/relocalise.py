"""Relocalisation: the pose of one camera from known points, without an initial pose."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from pocketgs.geometry.camera import Camera
from pocketgs.prior.bundle.adjustment import BundleSettings, adjust_pose
from pocketgs.prior.features.observations import Observations
from pocketgs.prior.features.tracks import reprojection_errors

MIN_SIGHTINGS, MIN_CELLS = 24, 5
"""Minimum number of agreeing observations of a pose, and of 4 x 4 image cells that contain them."""

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
    if len(points) < MIN_SIGHTINGS:
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
        if not enough(camera, pixels[near]):
            return None
        placed = adjust_pose(placed, points[near], pixels[near], BundleSettings(huber=tolerance / 2)).camera
    return placed if enough(camera, pixels[agreeing(placed, points, pixels, tolerance)]) else None


def agreeing(camera: Camera, points: np.ndarray, pixels: np.ndarray, tolerance: float) -> np.ndarray:
    """(M,) bool: pixels within the tolerance of the points' projections."""
    each = np.arange(len(points))
    return reprojection_errors([camera], points, Observations(np.zeros_like(each), each, pixels)) < tolerance


def enough(camera: Camera, pixels: np.ndarray) -> bool:
    """Whether observations at these pixels are enough, and well enough spread, for a pose."""
    return len(pixels) >= MIN_SIGHTINGS and cells(camera, pixels) >= MIN_CELLS


def cells(camera: Camera, pixels: np.ndarray) -> int:
    """Number of the 4 x 4 cells of the camera's image that contain pixels."""
    across, down = np.clip(pixels / (camera.width, camera.height) * 4, 0, 3).astype(np.int64).T
    return len(np.unique(4 * down + across))
