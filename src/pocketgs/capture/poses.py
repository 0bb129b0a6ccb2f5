"""Checking poses and intrinsics that a capture states, and converting them to this project's conventions."""

from __future__ import annotations

import numpy as np

from pocketgs.errors import PocketGSError, short
from pocketgs.geometry.camera import MAX_SIDE, Camera
from pocketgs.geometry.quaternions import rotation_matrices

ROTATION_TOLERANCE = 1e-2
"""Maximum difference of RᵀR from the identity: matrices written with three digits are within it."""

MAX_COORDINATE = 1e9
MIN_FOCAL_LENGTH, MAX_INTRINSIC = 1e-2, 1e7
"""Bounds on what files may state: beyond them computations in float32 would overflow, and the file is damaged."""

ARKIT_PIXEL_CENTRE = 0.5
"""Offset from ARKit's principal point, measured from the centre of the top left pixel, to ours, from its corner.

The projection matrices of a real recording agree with it to 0.0001 pixels.
"""


def world_to_camera_of(rotation: np.ndarray, translation: np.ndarray, where: str) -> np.ndarray:
    """(4, 4) world_to_camera from a rotation and a translation.

    Rotations that are slightly off through rounding are replaced by the nearest exact one.

    Args:
        rotation: (3, 3), world to camera, OpenCV axes.
        translation: (3,).
        where: file and frame, for error messages.

    Raises:
        PocketGSError: a number is not finite, a coordinate is too large, or the 3x3 block is not a rotation.
    """
    if not (np.all(np.isfinite(rotation)) and np.all(np.abs(translation) < MAX_COORDINATE)):
        raise PocketGSError(f"{where}: the pose holds NaN or coordinates beyond {MAX_COORDINATE:g}")
    if np.abs(rotation).max() > 2 or np.abs(rotation @ rotation.T - np.eye(3)).max() > ROTATION_TOLERANCE:
        raise PocketGSError(f"{where}: the pose is not rigid, expected a rotation without scale or shear")
    if np.linalg.det(rotation) < 0:
        raise PocketGSError(f"{where}: the pose mirrors the scene, expected a rotation with determinant +1")
    left, _, right = np.linalg.svd(rotation)
    pose = np.eye(4)
    pose[:3, :3] = left @ right
    pose[:3, 3] = translation
    return pose


def world_to_camera_from_axes(axes: np.ndarray, centre: np.ndarray, where: str) -> np.ndarray:
    """(4, 4) world_to_camera of the camera at `centre` whose right, down and forward axes are the columns of `axes`.

    Raises:
        PocketGSError: as `world_to_camera_of`.
    """
    # The inverse of a rotation is its transpose: check it first, then use the exact one.
    rotation = world_to_camera_of(axes.T, centre, where)[:3, :3]
    return world_to_camera_of(rotation, -rotation @ centre, where)


def world_to_camera_from_opengl(axes: np.ndarray, centre: np.ndarray, where: str) -> np.ndarray:
    """(4, 4) world_to_camera of the camera at `centre` whose right, up and back axes are the columns of `axes`.

    These are the axes of OpenGL and ARKit.

    Raises:
        PocketGSError: as `world_to_camera_of`.
    """
    return world_to_camera_from_axes(axes * (1.0, -1.0, -1.0), centre, where)


def rotation_from_quaternion(quaternion: np.ndarray, where: str) -> np.ndarray:
    """(3, 3) rotation of a (4,) quaternion w, x, y, z of any length.

    Raises:
        PocketGSError: the quaternion is zero or not finite.
    """
    largest = np.abs(quaternion).max()
    if not np.isfinite(largest) or largest == 0:
        raise PocketGSError(f"{where}: rotation quaternion {quaternion.tolist()}, expected finite and not zero")
    # Normalised by the largest first, so that squares neither overflow nor underflow.
    rotation: np.ndarray = rotation_matrices((quaternion / largest)[None])[0]
    return rotation


def camera_at(
    where: str, size: tuple[float, float], focal: tuple[float, float], centre: tuple[float, float], pose: np.ndarray
) -> Camera:
    """Make a camera from numbers that a file states.

    Args:
        where: file and frame, for error messages.
        size: width and height in pixels.
        focal: fx and fy in pixels.
        centre: cx and cy in pixels, pixel centres at + 0.5.
        pose: (4, 4) world_to_camera.

    Raises:
        PocketGSError: a number is not finite, not positive or too large.
    """
    if not all(1 <= side <= MAX_SIDE for side in size):
        found = "x".join(map(short, size))
        raise PocketGSError(f"{where}: image size {found}, expected 1 to {MAX_SIDE} pixels a side")
    if not all(MIN_FOCAL_LENGTH <= value <= MAX_INTRINSIC for value in focal):
        raise PocketGSError(
            f"{where}: focal lengths {', '.join(map(short, focal))}, expected positive numbers of pixels"
        )
    if not all(abs(value) <= MAX_INTRINSIC for value in centre):
        raise PocketGSError(f"{where}: principal point {', '.join(map(short, centre))}, expected pixels of the image")
    (width, height), (fx, fy), (cx, cy) = size, focal, centre
    return Camera(round(width), round(height), float(fx), float(fy), float(cx), float(cy), pose)
