"""Normalising a model of arbitrary scale, origin and orientation: upright, centred and scaled.

Axes are x right, y down, z forward, as those of the 3DGS `.ply`. Imported by COLMAP's process: NumPy only.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pocketgs.geometry.up_direction import up_direction

MEDIAN_DISTANCE = 3.0
"""Median distance from cameras to their points if the scale is unknown: as from a person to a subject."""

MIN_GPS_SPREAD = 10.0
"""GPS positions determine the scale if their spread is this many times their deviation from the cameras."""

MIN_PLACES = 5
MIN_SHARE_OF_PLACES = 0.6
ROBUST_ROUNDS = 10


@dataclass(frozen=True)
class Similarity:
    """x -> scale * rotation @ x + shift."""

    scale: float
    rotation: np.ndarray
    shift: np.ndarray

    def apply(self, points: np.ndarray) -> np.ndarray:
        """Transform (N, 3) points."""
        return self.scale * points @ self.rotation.T + self.shift


def similarity(source: np.ndarray, target: np.ndarray, weights: np.ndarray | None = None) -> Similarity:
    """The least-squares similarity that maps (N, 3) points to others (Umeyama, 1991, eqs. 40-42).

    Args:
        source: points, not all equal.
        target: corresponding points.
        weights: (N,), or None for 1 each.
    """
    shares = np.ones(len(source)) if weights is None else weights
    shares = shares / shares.sum()
    source_mean, target_mean = shares @ source, shares @ target
    centred = source - source_mean
    left, singular, right = np.linalg.svd((target - target_mean).T @ (shares[:, None] * centred))
    signs = np.array([1, 1, np.sign(np.linalg.det(left @ right))])
    rotation = left @ np.diag(signs) @ right
    scale = float((singular * signs).sum() / max(float(shares @ (centred**2).sum(axis=1)), 1e-300))
    return Similarity(scale, rotation, target_mean - scale * rotation @ source_mean)


def from_places(centres: np.ndarray, places: np.ndarray) -> Similarity | None:
    """The similarity from camera centres to GPS positions, or None if these are not reliable enough.

    They must be spread in two directions, many times as far as they deviate from the camera centres, and most must
    agree.

    Args:
        centres: (N, 3) of cameras.
        places: (N, 3) metres, NaN where unknown.
    """
    known = np.isfinite(places).all(axis=1)
    centres, places = centres[known], places[known]
    if len(places) < MIN_PLACES:
        return None
    weights = np.ones(len(places))
    for _ in range(ROBUST_ROUNDS):
        found = similarity(centres, places, weights)
        errors = np.linalg.norm(found.apply(centres) - places, axis=1)
        # Geman-McClure weights: positions that deviate by many times the median hardly count.
        unit = max(float(np.median(errors)) * 2, 1e-9)
        weights = 1 / (1 + (errors / unit) ** 2) ** 2
    agree = errors < 3 * unit
    if agree.mean() < MIN_SHARE_OF_PLACES or found.scale <= 0:
        return None
    spreads = np.linalg.svd(places[agree] - places[agree].mean(axis=0), compute_uv=False) / np.sqrt(agree.sum())
    error = float(np.sqrt(np.mean(errors[agree] ** 2)))
    return found if spreads[0] > MIN_GPS_SPREAD * error and spreads[1] > MIN_GPS_SPREAD / 2 * error else None


def upright(rotations: np.ndarray, centres: np.ndarray, points: np.ndarray) -> Similarity:
    """The similarity to a world that is upright, centred on the subject, and scaled to `MEDIAN_DISTANCE`.

    Args:
        rotations: (N, 3, 3) world to camera.
        centres: (N, 3) of cameras.
        points: (M, 3) seen by the cameras.
    """
    down = -up_direction(rotations)
    forward = rotations[:, 2].mean(axis=0)
    forward = forward - (forward @ down) * down
    if np.linalg.norm(forward) < 0.05:  # cameras all around: any direction works
        forward = np.eye(3)[np.argmin(np.abs(down))]
        forward = forward - (forward @ down) * down
    forward = forward / np.linalg.norm(forward)
    rotation = np.stack([np.cross(down, forward), down, forward])
    middle = np.median(points, axis=0)
    distance = float(np.median(np.linalg.norm(centres - middle, axis=1)))
    scale = MEDIAN_DISTANCE / distance if distance > 0 else 1.0
    return Similarity(scale, rotation, -scale * rotation @ middle)
