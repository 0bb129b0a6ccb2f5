"""Where one camera stands, from points that others know: no given pose is needed."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from pocketgs.geometry.camera import Camera
from pocketgs.prior.bundle import BundleSettings, adjust_pose
from pocketgs.prior.observations import Observations
from pocketgs.prior.tracks import reprojection_errors

MIN_SIGHTINGS, MIN_CELLS = 24, 5
"""A pose that fewer sightings agree on, or in fewer of 4 x 4 parts of the image, is not believed."""

CONFIDENCE, TRIALS = 0.9999, 2000


def pose_from_points(camera: Camera, points: np.ndarray, pixels: np.ndarray, tolerance: float) -> Camera | None:
    """The camera at the pose that most sightings agree on, or None if too few do.

    RANSAC over three points at a time (Gao et al. 2003, in OpenCV), then least squares over all that agree.

    Args:
        camera: gives the intrinsics.
        points: (M, 3) in the world.
        pixels: (M, 2) where they may have been seen; wrong ones among them.
        tolerance: distance in pixels within which a sighting agrees.
    """
    if len(points) < MIN_SIGHTINGS:
        return None
    # OpenCV's RANSAC works in single precision on the points: it takes them about their middle, and small.
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
    except cv2.error:  # the solver meets a degenerate sample
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
    """(M,) bool: pixels within the tolerance of where the points fall."""
    each = np.arange(len(points))
    return reprojection_errors([camera], points, Observations(np.zeros_like(each), each, pixels)) < tolerance


def enough(camera: Camera, pixels: np.ndarray) -> bool:
    """Whether sightings at these pixels are enough, and spread enough, to tell a pose."""
    return len(pixels) >= MIN_SIGHTINGS and cells(camera, pixels) >= MIN_CELLS


def cells(camera: Camera, pixels: np.ndarray) -> int:
    """In how many of 4 x 4 parts of the camera's image pixels lie."""
    across, down = np.clip(pixels / (camera.width, camera.height) * 4, 0, 3).astype(np.int64).T
    return len(np.unique(4 * down + across))
