"""Reprojection errors and their derivatives by poses and points."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from pocketgs.system.compile import kernel, part

CAMERA_UNKNOWNS = 6
"""Per camera: a rotation vector ω, then the centre c. An update changes R to exp(ω)·R and c to c + δ."""

COLUMNS = CAMERA_UNKNOWNS + 3
"""Of a Jacobian: the camera's unknowns, then the point's three coordinates."""

BEHIND = 1e4
"""Reprojection error in pixels of a point that is not in front of its camera: larger than any in an image."""

GRAZING = 1e-6
"""Minimum cosine of the angle to the optical axis for a point in front of the camera."""


class Sightings(NamedTuple):
    """Observations, sorted by point.

    Attributes:
        intrinsics: (F, 4) float64 fx, fy, cx, cy of each camera.
        frame: (M,) int64 index of the camera.
        point: (M,) int64 index of the point.
        starts: (N + 1,) int64: observations of point p are starts[p] to starts[p + 1].
        pixels: (M, 2) float64 positions.
    """

    intrinsics: np.ndarray
    frame: np.ndarray
    point: np.ndarray
    starts: np.ndarray
    pixels: np.ndarray


class Estimate(NamedTuple):
    """The unknowns of bundle adjustment.

    Attributes:
        rotations: (F, 3, 3) float64 from world to camera axes.
        centres: (F, 3) float64 camera centres in the world.
        points: (N, 3) float64 in the world.
    """

    rotations: np.ndarray
    centres: np.ndarray
    points: np.ndarray


@kernel
def distances(sightings: Sightings, estimate: Estimate) -> np.ndarray:
    """(M,) float64 reprojection errors in pixels, `BEHIND` for points that are not in front of the camera."""
    count = len(sightings.frame)
    lengths = np.empty(count)
    residual, jacobian = np.empty(2), np.empty((2, COLUMNS))
    for k in range(count):
        if linearise(sightings, estimate, k, residual, jacobian):
            lengths[k] = math.sqrt(residual[0] ** 2 + residual[1] ** 2)
        else:
            lengths[k] = BEHIND
    return lengths


@part
def linearise(sightings: Sightings, estimate: Estimate, k: int, residual: np.ndarray, jacobian: np.ndarray) -> bool:
    """Write the residual of observation k, predicted minus observed, and its derivatives.

    Returns False for a point that is not in front of the camera: it has no residual and no gradient.

    Args:
        sightings: the observations.
        estimate: where to linearise.
        k: index of the observation.
        residual: (2,) output, in pixels.
        jacobian: (2, COLUMNS) output: rotation, centre, point.
    """
    frame, point = sightings.frame[k], sightings.point[k]
    rotation, centre, position = estimate.rotations[frame], estimate.centres[frame], estimate.points[point]
    dx, dy, dz = position[0] - centre[0], position[1] - centre[1], position[2] - centre[2]
    x = rotation[0, 0] * dx + rotation[0, 1] * dy + rotation[0, 2] * dz
    y = rotation[1, 0] * dx + rotation[1, 1] * dy + rotation[1, 2] * dz
    z = rotation[2, 0] * dx + rotation[2, 1] * dy + rotation[2, 2] * dz
    if not z > GRAZING * math.sqrt(x * x + y * y + z * z):
        return False
    for axis in range(2):
        focal = sightings.intrinsics[frame, axis]
        own = x / z if axis == 0 else y / z
        residual[axis] = focal * own + sightings.intrinsics[frame, 2 + axis] - sightings.pixels[k, axis]
        # The gradient by (x, y, z), the point in camera axes. A rotation ω moves it by ω × (x, y, z), and
        # g · (ω × x) = ω · (x × g).
        across = focal / z if axis == 0 else 0.0
        down = 0.0 if axis == 0 else focal / z
        inward = -focal * own / z
        row = jacobian[axis]
        row[0], row[1], row[2] = y * inward - z * down, z * across - x * inward, x * down - y * across
        for column in range(3):
            slope = across * rotation[0, column] + down * rotation[1, column] + inward * rotation[2, column]
            row[3 + column], row[CAMERA_UNKNOWNS + column] = -slope, slope
    return True


@part
def weigh(residual: np.ndarray, jacobian: np.ndarray, huber: float) -> None:
    """Multiply both by √w, so that least squares has the gradient of the Huber loss: w = min(1, huber / |r|).

    Iteratively reweighted least squares: Zhang, "Parameter estimation techniques" (1997), section 9.
    """
    length = math.sqrt(residual[0] ** 2 + residual[1] ** 2)
    if length > huber:
        root = math.sqrt(huber / length)
        for row in range(2):
            residual[row] *= root
            for column in range(COLUMNS):
                jacobian[row, column] *= root
