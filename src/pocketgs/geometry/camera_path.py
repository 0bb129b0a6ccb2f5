"""Camera paths for renderings: an orbit around a capture, and smooth paths through given cameras."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

from pocketgs.errors import PocketGSError
from pocketgs.geometry.camera import Camera, look_at
from pocketgs.geometry.camera_geometry import focus_point, looks_at, upward

SURROUNDED_BELOW_GAP = np.radians(120)
MIN_SWAY = np.radians(2)
HIGHEST = np.radians(89)
"""Maximum elevation of an orbit's cameras: straight above the focus, none of their directions is upward."""
WRAPPED_KEYS = 3


def orbit(cameras: Sequence[Camera], count: int, focus: np.ndarray | None = None) -> list[Camera]:
    """Make a closed camera path around the subject of a capture.

    Positions are given by azimuth and elevation about the focus, at the cameras' mean distance from it:

    - if the cameras surround the focus (no gap of 120 degrees or more between neighbouring azimuths), a full circle at
      their mean elevation;
    - if they face one way, an ellipse about their mean direction, as wide and as high as they are spread (at least 2
      degrees, so that a single camera also moves);
    - in both cases at most 89 degrees above or below the focus;
    - if they look outwards, so that there is no subject to circle, the path through the cameras themselves.

    Args:
        cameras: the capture's, in any order (in capture order for the last case).
        count: how many cameras to make; the one after the last would be the first again.
        focus: (3,) the point to look at, or None for the point nearest to all optical axes.

    Returns:
        `count` cameras with the size and intrinsics of the first one given.

    Raises:
        PocketGSError: there are no cameras, `count` is not positive, or a camera is at the focus.
    """
    _check(cameras, count)
    target = focus_point(cameras) if focus is None else np.asarray(focus, dtype=np.float64)
    if not looks_at(cameras, target):
        return path(cameras, count, closed=True)
    frame = _frame_about(cameras, target)
    offsets = (np.array([camera.centre for camera in cameras]) - target) @ frame.T
    distance = np.linalg.norm(offsets, axis=1)
    if not distance.all():
        raise PocketGSError(f"camera path: camera {np.argmin(distance)} is at the focus, expected another focus")
    azimuth = np.arctan2(offsets[:, 1], offsets[:, 0])
    elevation = np.arcsin(np.clip(offsets[:, 2] / distance, -1, 1))
    turn = 2 * np.pi * np.arange(count) / count
    if _largest_gap(azimuth) < SURROUNDED_BELOW_GAP:
        azimuths, elevations = azimuth[0] + turn, np.full(count, elevation.mean())
    else:
        azimuths = azimuth.mean() + _sway(azimuth) * np.sin(turn)
        elevations = elevation.mean() + _sway(elevation) * np.cos(turn)
    elevations = np.clip(elevations, -HIGHEST, HIGHEST)
    flat = np.cos(elevations)
    directions = np.stack([flat * np.cos(azimuths), flat * np.sin(azimuths), np.sin(elevations)], axis=1)
    eyes = target + distance.mean() * directions @ frame
    return [replace(cameras[0], world_to_camera=look_at(eye, target, frame[2])) for eye in eyes]


def path(cameras: Sequence[Camera], count: int, closed: bool = False) -> list[Camera]:
    """Make a smooth camera path through given cameras, with equal numbers of steps between them.

    Positions follow a cubic spline and orientations a rotation spline, both with continuous velocity.

    Args:
        cameras: one or more, in order; a path through one stands still.
        count: how many cameras to make.
        closed: whether to return to the first camera. An open path ends at the last one; on a closed one, the camera
            after the last would be the first again.

    Returns:
        `count` cameras with the size and intrinsics of the first one given.

    Raises:
        PocketGSError: there are no cameras or `count` is not positive.
    """
    _check(cameras, count)
    if len(cameras) == 1:
        return [cameras[0]] * count
    keys = np.arange(-WRAPPED_KEYS, len(cameras) + WRAPPED_KEYS + 1) if closed else np.arange(len(cameras))
    # A closed path is extended beyond its seam at both ends, so that its velocity is continuous there.
    key_poses = np.array([cameras[key % len(cameras)].camera_to_world for key in keys])
    times = np.linspace(0, len(cameras), count, endpoint=False) if closed else np.linspace(0, len(cameras) - 1, count)
    centres = CubicSpline(keys, key_poses[:, :3, 3])(times)
    rotations = RotationSpline(keys, Rotation.from_matrix(key_poses[:, :3, :3]))(times).as_matrix()
    return [
        replace(cameras[0], world_to_camera=_world_to_camera(rotation, centre))
        for rotation, centre in zip(rotations, centres, strict=True)
    ]


def _frame_about(cameras: Sequence[Camera], target: np.ndarray) -> np.ndarray:
    """(3, 3) axes in rows: towards the cameras, sideways, up. Azimuth jumps at π, behind the target."""
    up = upward(cameras)
    towards = np.mean([camera.centre for camera in cameras], axis=0) - target
    flat = towards - (towards @ up) * up
    if np.linalg.norm(flat) < 1e-9:
        flat = np.cross(up, np.eye(3)[np.argmin(np.abs(up))])
    flat = flat / np.linalg.norm(flat)
    return np.stack([flat, np.cross(up, flat), up])


def _largest_gap(angles: np.ndarray) -> float:
    """Largest angle between neighbours on the circle."""
    ordered = np.sort(angles % (2 * np.pi))
    return float(np.diff(ordered, append=ordered[0] + 2 * np.pi).max())


def _sway(angles: np.ndarray) -> float:
    """Amplitude of a sine with the same spread as the angles."""
    return max(float(np.sqrt(2) * np.std(angles)), MIN_SWAY)


def _world_to_camera(rotation: np.ndarray, centre: np.ndarray) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, :3] = rotation.T
    pose[:3, 3] = -rotation.T @ centre
    return pose


def _check(cameras: Sequence[Camera], count: int) -> None:
    if not cameras:
        raise PocketGSError("camera path: no cameras, expected at least one")
    if count < 1:
        raise PocketGSError(f"camera path: {count} cameras to make, expected at least 1")
