"""How far sightings of one point may lie apart: measured from them, between noise and what poses may be off."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pocketgs.geometry.camera import Camera
from pocketgs.prior.consensus import consensus
from pocketgs.prior.observations import Observations

MIN_ANGLE = np.radians(1.5)
"""Angle between two rays below which they do not tell how far the point is."""

WIDEST = 0.02
"""Share of an image's longer side beyond which two views contradict each other: a phone's poses drift by degrees."""

MEDIANS = 4.0
"""Tolerance in units of the median error: all but 0.1 % of errors that are normal in each direction lie within."""

FINEST = 1.0
"""Pixels of the images that features were found in, below which errors are noise."""

ROUNDS = 6


def widest_tolerance(cameras: Sequence[Camera]) -> float:
    """Pixels that a sighting may be off where nothing better is known."""
    return WIDEST * float(np.median([max(camera.width, camera.height) for camera in cameras]))


def next_tolerance(errors: np.ndarray, tolerance: float, finest: float) -> float:
    """The tolerance that errors within the last one ask for.

    Args:
        errors: in pixels.
        tolerance: the last one.
        finest: the next is no smaller.
    """
    within = errors[errors < tolerance]
    return min(tolerance, max(finest, MEDIANS * float(np.median(within)))) if len(within) else tolerance


def measured_tolerance(cameras: Sequence[Camera], tracks: Observations, finest: float) -> float:
    """How far sightings may be off under poses, in pixels: shrunk from the widest for as long as most stay within it.

    Where some poses are wrong, those that are right decide.

    Args:
        cameras: of the views.
        tracks: sightings sorted by point.
        finest: the result is no smaller.
    """
    tolerance = widest_tolerance(cameras)
    for _ in range(ROUNDS):
        found = consensus(cameras, tracks, tolerance, MIN_ANGLE)
        last, tolerance = tolerance, next_tolerance(found.error[found.agrees & (found.support >= 2)], tolerance, finest)
        if tolerance > 0.9 * last:
            break
    return tolerance
