"""Estimates from a set of cameras: the scene's centre, and the up direction."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pocketgs.errors import PocketGSError
from pocketgs.geometry.camera import Camera
from pocketgs.geometry.up_direction import up_direction

# Optical axes within about 1.8 degrees of each other (sin² below this) do not determine a distance.
MIN_CONVERGENCE = 1e-3
GUESSED_DISTANCE = 4.0

ROUNDING = 1e-9
"""Lengths below this share of the distance to the origin, or below its square, are rounding."""


def focus_point(cameras: Sequence[Camera]) -> np.ndarray:
    """(3,) point nearest to all optical axes in the least squares sense.

    If the axes are parallel, or there is only one camera, the distance is undetermined: the point is then placed in
    front of the cameras' mean centre at four times their RMS distance from it (at 1 for cameras in one place). Axes
    that meet behind a camera also count: see `looks_at`.

    Raises:
        PocketGSError: there are no cameras.
    """
    if not cameras:
        raise PocketGSError("focus point: no cameras, expected at least one")
    centres = np.array([camera.centre for camera in cameras])
    forwards = np.array([camera.forward for camera in cameras])
    centre = centres.mean(axis=0)
    spread = spread_of(centres)
    guess = centre + mean_direction(forwards) * (GUESSED_DISTANCE * spread if spread > 0 else 1.0)
    across = np.eye(3) - forwards[:, :, None] * forwards[:, None, :]
    residual = np.einsum("nij,nj->i", across, centres - guess) / len(cameras)
    step, *_ = np.linalg.lstsq(across.mean(axis=0), residual, rcond=MIN_CONVERGENCE)
    return guess + step


def spread_of(centres: np.ndarray) -> float:
    """Root mean square of the distances of (N, 3) places from their mean; 0 if it is within rounding."""
    spread = float(np.sqrt(centres.var(axis=0).sum()))
    rounding = max(ROUNDING * float(np.abs(centres).max()), ROUNDING**2)
    return spread if spread > rounding else 0.0


def looks_at(cameras: Sequence[Camera], point: np.ndarray) -> bool:
    """Whether the point lies in front of more than half of the cameras.

    It does not if they face outwards from it, or are in one place: their axes then meet in that place.
    """
    if len(cameras) > 1 and spread_of(np.array([camera.centre for camera in cameras])) == 0:
        return False
    in_front = [camera.forward @ (point - camera.centre) > 0 for camera in cameras]
    return 2 * sum(in_front) > len(in_front)


def upward(cameras: Sequence[Camera]) -> np.ndarray:
    """(3,) up direction of the world, see `up_direction`."""
    return up_direction(np.array([camera.world_to_camera[:3, :3] for camera in cameras]))


def mean_direction(directions: np.ndarray) -> np.ndarray:
    """(3,) normalised mean of (N, 3) unit directions; the first of them if they cancel out."""
    mean = directions.mean(axis=0)
    length = float(np.linalg.norm(mean))
    return mean / length if length > 1e-9 else directions[0]
