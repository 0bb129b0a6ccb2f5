"""The tolerance of reprojection errors, estimated from the data: between noise and the possible error of poses."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pocketgs.geometry.camera import Camera
from pocketgs.prior.features.observations import Observations
from pocketgs.prior.poses.consensus import consensus

MIN_ANGLE = np.radians(1.5)
"""Minimum angle between two rays that determines a point's distance."""

WIDEST = 0.02
"""Maximum tolerance as a share of an image's longer side: a phone's poses drift by degrees."""

MEDIANS = 4.0
"""Tolerance in units of the median error: it includes all but 0.1 % of normally distributed errors."""

FINEST = 1.0
"""Minimum tolerance in pixels of the images used for detection; smaller errors are noise."""

ROUNDS = 6


def widest_tolerance(cameras: Sequence[Camera]) -> float:
    """Initial tolerance in pixels."""
    return WIDEST * float(np.median([max(camera.width, camera.height) for camera in cameras]))


def next_tolerance(errors: np.ndarray, tolerance: float, finest: float) -> float:
    """The next tolerance, from the errors within the last one.

    Args:
        errors: in pixels.
        tolerance: the last one.
        finest: lower bound.
    """
    within = errors[errors < tolerance]
    return min(tolerance, max(finest, MEDIANS * float(np.median(within)))) if len(within) else tolerance


def measured_tolerance(cameras: Sequence[Camera], tracks: Observations, finest: float) -> float:
    """Estimate the tolerance in pixels under given poses: reduced from the widest as long as most errors stay within.

    If some poses are wrong, the correct ones decide.

    Args:
        cameras: of the views.
        tracks: observations sorted by point.
        finest: lower bound.
    """
    tolerance = widest_tolerance(cameras)
    for _ in range(ROUNDS):
        found = consensus(cameras, tracks, tolerance, MIN_ANGLE)
        last, tolerance = tolerance, next_tolerance(found.error[found.agrees & (found.support >= 2)], tolerance, finest)
        if tolerance > 0.9 * last:
            break
    return tolerance
