"""Culling of clusters for views through a lens: by cones about the optical axis, since straight sides would bend."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from pocketgs.geometry.lens import Lens, distort, fisheye_radius, largest_angle, least_radii
from pocketgs.splat.constants import ALPHA_MIN, LOW_PASS
from pocketgs.splat.cpu.layout import View
from pocketgs.splat.cpu.lenses.lens import Fisheye, Perspective

REACH = 1.001 * math.sqrt(-2.0 * math.log(ALPHA_MIN))
"""At least the reach of the most opaque Gaussian, in standard deviations, with a margin for rounding."""

_BLUR = REACH * math.sqrt(LOW_PASS) + 0.5

_SLACK = 0.02
"""Relative margin for extrema of a lens between samples."""


def outside_parallel(centres: np.ndarray, halves: np.ndarray, sigma: np.ndarray, view: View, near: float) -> np.ndarray:
    """(M,) bool: boxes outside an orthographic view; arguments as `outside_cone`."""
    rotation = view.rotation

    def largest(normal: np.ndarray) -> np.ndarray:
        return np.asarray(centres @ normal + halves @ np.abs(normal))

    found = largest(rotation[2]) < near
    for axis, focal, centre, size in ((0, view.fx, view.cx, view.width), (1, view.fy, view.cy, view.height)):
        spread = REACH * focal * sigma + _BLUR
        found |= largest(focal * rotation[axis]) + centre + spread < 0.0
        found |= largest(-focal * rotation[axis]) + size - centre + spread < 0.0
    return np.asarray(found)


def outside_cone(
    centres: np.ndarray,
    halves: np.ndarray,
    sigma: np.ndarray,
    view: View,
    lens: Perspective | Fisheye,
    near: float,
) -> np.ndarray:
    """(M,) bool: boxes outside a view through a lens.

    A ball around the box contains all means, so none is closer to the axis than a certain angle. The lens projects
    points beyond that angle at least a certain distance from the principal point, and no Gaussian extends further than
    its largest standard deviation allows at the ball's minimum distance.

    Args:
        centres: (M, 3) centres of boxes around the means, relative to the camera, in the world's axes.
        halves: (M, 3) half the boxes' sides.
        sigma: (M,) largest standard deviation.
        view: the camera.
        lens: of the camera.
        near: minimum depth of drawn Gaussians.
    """
    shape = _shape_of(lens)
    angles, radii = least_radii(shape)
    local = centres @ view.rotation.T
    radius, distance = np.linalg.norm(halves, axis=1), np.linalg.norm(local, axis=1)
    spread = np.where(distance > radius, np.arcsin(np.minimum(radius / distance, 1.0)), math.pi)
    least = np.maximum(np.arctan2(np.hypot(local[:, 0], local[:, 1]), local[:, 2]) - spread, 0.0)
    found = least > largest_angle(shape) + 1e-6
    if isinstance(lens, Fisheye):
        depth, stretch = distance - radius, _stretch_of_angles(shape)
        found |= distance + radius < near
    else:
        reach = halves @ np.abs(view.rotation[2])
        depth, stretch = local[:, 2] - reach, _stretch_of_slopes(lens)
        found |= local[:, 2] + reach < near
    pixels = REACH * stretch * max(view.fx, view.fy) * sigma / np.maximum(depth, near) + _BLUR
    corner = np.hypot(max(view.cx, view.width - view.cx), max(view.cy, view.height - view.cy))
    shown = radii[np.clip(np.searchsorted(angles, least, side="right") - 1, 0, len(angles) - 1)]
    found |= min(view.fx, view.fy) * (1.0 - _SLACK) * shown - pixels > corner
    return np.asarray(found)


def _shape_of(lens: Perspective | Fisheye) -> Lens:
    """The `Lens` of a kernel's lens."""
    return Lens("fisheye", tuple(lens[:4])) if isinstance(lens, Fisheye) else Lens("opencv", tuple(lens[:12]))


@lru_cache(maxsize=64)
def _stretch_of_angles(lens: Lens) -> float:
    """Maximum stretch of a fisheye: length on the image plane per unit of length at distance 1."""
    angles = np.linspace(1e-4, largest_angle(lens), 512)
    radii = fisheye_radius(lens, angles)
    slopes = np.gradient(radii, angles)
    return float((1.0 + _SLACK) * max(slopes.max(), (radii / np.sin(angles)).max()))


@lru_cache(maxsize=64)
def _stretch_of_slopes(lens: Perspective) -> float:
    """Maximum stretch of a lens: length on the image plane per unit of length at depth 1, where J is evaluated."""
    sides = [np.linspace(*ends, 65) for ends in ((lens.low_x, lens.high_x), (lens.low_y, lens.high_y))]
    points = np.stack(np.meshgrid(*sides), axis=-1).reshape(-1, 2)
    points = points[np.sum(points * points, axis=1) <= lens.largest_square]
    if len(points) == 0:
        return math.inf
    step = 1e-5
    shape = _shape_of(lens)
    columns = [
        (distort(shape, points + offset) - distort(shape, points - offset)) / (2 * step) for offset in step * np.eye(2)
    ]
    norms = np.linalg.norm(np.stack(columns, axis=2), axis=(1, 2)) * np.sqrt(1.0 + np.sum(points * points, axis=1))
    return float((1.0 + _SLACK) * norms.max())
