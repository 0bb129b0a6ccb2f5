"""Culling of clusters for views through a lens: by cones about the optical axis, since straight sides would bend."""

from __future__ import annotations

import math

import numpy as np

from pocketgs.geometry.lens import Lens, largest_angle, least_radii
from pocketgs.splat.constants import ALPHA_MIN, LOW_PASS
from pocketgs.splat.cpu.layout import View
from pocketgs.splat.cpu.lenses.lens import Fisheye, Perspective
from pocketgs.splat.lens_bounds import SLACK, stretch

REACH = 1.001 * math.sqrt(-2.0 * math.log(ALPHA_MIN))
"""At least the reach of the most opaque Gaussian, in standard deviations, with a margin for rounding."""

_BLUR = REACH * math.sqrt(LOW_PASS) + 0.5


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
        depth, longest = distance - radius, stretch(shape, (0.0, 0.0), (0.0, 0.0))
        found |= distance + radius < near
    else:
        reach = halves @ np.abs(view.rotation[2])
        depth, longest = local[:, 2] - reach, stretch(shape, (lens.low_x, lens.low_y), (lens.high_x, lens.high_y))
        found |= local[:, 2] + reach < near
    pixels = REACH * longest * max(view.fx, view.fy) * sigma / np.maximum(depth, near) + _BLUR
    corner = np.hypot(max(view.cx, view.width - view.cx), max(view.cy, view.height - view.cy))
    shown = radii[np.clip(np.searchsorted(angles, least, side="right") - 1, 0, len(angles) - 1)]
    found |= min(view.fx, view.fy) * (1.0 - SLACK) * shown - pixels > corner
    return np.asarray(found)


def _shape_of(lens: Perspective | Fisheye) -> Lens:
    """The `Lens` of a kernel's lens."""
    return Lens("fisheye", tuple(lens[:4])) if isinstance(lens, Fisheye) else Lens("opencv", tuple(lens[:12]))
