"""The up direction, estimated from hand-held cameras. NumPy only, since COLMAP's process imports it."""

from __future__ import annotations

import numpy as np

MIN_VARIETY, CLEARER = 0.001, 8.0
"""Minimum variance of level axes across their main direction that determines the horizontal plane: 2 degrees of
heading, and clearly more than cameras lean in the hand."""

ROBUST_ROUNDS = 10


def up_direction(rotations: np.ndarray) -> np.ndarray:
    """(3,) up direction of cameras that are held level, in landscape or portrait.

    A level camera's horizontal axis is horizontal at any tilt, so up is perpendicular to all of these axes. If they all
    have one direction, up is the perpendicular nearest to the images' upward directions.

    Args:
        rotations: (N, 3, 3) world to camera.
    """
    ups = np.stack([-rotations[:, 1], rotations[:, 1], rotations[:, 0], -rotations[:, 0]], axis=1)
    up = _most_common(ups[:, 0])
    for _ in range(ROBUST_ROUNDS):
        # The orientation of these photographs was not recorded: use the image side that points up most.
        side = np.argmax(ups @ up, axis=1)
        own = np.take_along_axis(ups, side[:, None, None], axis=1)[:, 0]
        across = np.cross(own, rotations[:, 2])
        tilt = np.abs(across @ up)
        weights = 1 / (1 + (tilt / max(0.05, 2 * float(np.median(tilt)))) ** 2) ** 2
        found = _at_right_angles(across, own, weights)
        if found @ up > 1 - 1e-12:
            break
        up = found
    return up


def _at_right_angles(across: np.ndarray, ups: np.ndarray, weights: np.ndarray) -> np.ndarray:
    mean_up = (weights[:, None] * ups).sum(axis=0)
    values, vectors = np.linalg.eigh((weights[:, None] * across).T @ across / weights.sum())
    if values[1] > max(MIN_VARIETY, CLEARER * values[0]):
        up = vectors[:, 0]
        return up if up @ mean_up >= 0 else -up
    up = mean_up - (mean_up @ vectors[:, 2]) * vectors[:, 2]
    length = float(np.linalg.norm(up))
    return up / length if length > 1e-6 else ups[0]


def _most_common(directions: np.ndarray) -> np.ndarray:
    """The direction closest to most others."""
    return directions[np.argmax(np.maximum(directions @ directions.T, 0).sum(axis=1))]
