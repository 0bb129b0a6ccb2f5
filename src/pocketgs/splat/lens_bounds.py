"""Bounds of what a lens does to a scene: they tell which Gaussians cannot be in a view."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from pocketgs.geometry.lens import KEPT_LENSES, Lens, distort, fisheye_radius, largest_angle, least_radii

SLACK = 0.02
"""Relative margin for extrema of a lens between samples."""

Pair = tuple[float, float]


@lru_cache(maxsize=KEPT_LENSES)
def stretch(lens: Lens, low: Pair, high: Pair) -> float:
    """Maximum length on the image plane of a unit of length, at depth 1, wherever the Jacobian is evaluated.

    Args:
        lens: "opencv" or "fisheye".
        low: least x/z and y/z at which it is evaluated, see `slope_limits`; unused for a fisheye.
        high: the largest.
    """
    if lens.model == "fisheye":
        angles = np.linspace(1e-4, largest_angle(lens), 512)
        radii = fisheye_radius(lens, angles)
        slopes = np.gradient(radii, angles)
        return float((1.0 + SLACK) * max(slopes.max(), (radii / np.sin(angles)).max()))
    sides = [np.linspace(*ends, 65) for ends in zip(low, high, strict=True)]
    points = np.stack(np.meshgrid(*sides), axis=-1).reshape(-1, 2)
    points = points[np.sum(points * points, axis=1) <= math.tan(largest_angle(lens)) ** 2]
    if len(points) == 0:
        return math.inf
    step = 1e-5
    columns = [
        (distort(lens, points + offset) - distort(lens, points - offset)) / (2 * step) for offset in step * np.eye(2)
    ]
    norms = np.linalg.norm(np.stack(columns, axis=2), axis=(1, 2)) * np.sqrt(1.0 + np.sum(points * points, axis=1))
    return float((1.0 + SLACK) * norms.max())


@lru_cache(maxsize=KEPT_LENSES)
def least_radius_per_radian(lens: Lens) -> float:
    """Minimum distance from the principal point, in focal lengths, of what lies beyond an angle, over that angle."""
    angles, radii = least_radii(lens)
    return float((1.0 - SLACK) * (radii[1:] / angles[1:]).min())
