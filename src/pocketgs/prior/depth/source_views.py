"""Source views: which frames a keyframe is compared with, and where its pixels fall in them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pocketgs.capture.capture import Frame
from pocketgs.geometry.camera import Camera
from pocketgs.prior.depth.sweep import SweepSettings

LEAST_PARALLAX = float(np.radians(0.2))
"""Minimum angle between the rays of two views to a point, in radians: with less, one view is a copy of the other.

Copies come from bursts, and from videos while the phone stands still. They match at every depth, so they confirm
whatever depth the other one has. At the size of a sweep, this angle is two to three pixels.
"""

BASELINE_SPREAD = 0.5
"""Standard deviation of the baseline score, relative to the target baseline."""

THIRD_VIEW = 0.2
"""Weight of a source view where two better ones see the same point: only the best two costs are averaged."""


def choose_source_views(
    keyframe: Frame, frames: Sequence[Frame], points: np.ndarray, settings: SweepSettings
) -> list[Frame]:
    """Choose the source views of a keyframe such that two of them see most of what it sees, from a good angle.

    A frame's score at a point is exp(-(b - b_target)² / 2 σ²) · min(α / α_min, 1), where b is the baseline and α the
    viewing angle at the point; 0 if it does not see the point, or from the same place, as copies of the keyframe do.
    Frames are chosen one by one by what they add to the two best scores of all points.

    Args:
        keyframe: the reference view.
        frames: to choose from; the keyframe itself is skipped.
        points: (N, 3) points that the keyframe sees.
        settings: number of source views, and angles.
    """
    others = [frame for frame in frames if frame.name != keyframe.name]
    scores = np.array([_scores(keyframe.camera, other.camera, points, settings) for other in others])
    best, second = np.zeros((2, len(points)))
    chosen: list[int] = []
    for _ in range(min(settings.source_views, len(others))):
        added = np.maximum(scores, second) - second + THIRD_VIEW * scores
        added[chosen] = -1.0
        index = int(np.argmax(added.sum(axis=1)))
        if not scores[index].any():
            break
        chosen.append(index)
        second = np.maximum(second, np.minimum(best, scores[index]))
        best = np.maximum(best, scores[index])
    return [others[index] for index in chosen]


def _scores(view: Camera, other: Camera, points: np.ndarray, settings: SweepSettings) -> np.ndarray:
    """(N,) score of another camera for estimating the depths of points."""
    pixels, depth = other.project(points)
    seen = other.shows(pixels, depth)
    here, there = view.centre - points, other.centre - points
    distances = np.linalg.norm(here, axis=1)
    cosine = np.sum(here * there, axis=1) / np.maximum(distances * np.linalg.norm(there, axis=1), 1e-30)
    angle = np.arccos(np.clip(cosine, -1.0, 1.0))
    target = np.tan(settings.angle) * distances
    baseline = np.linalg.norm(view.centre - other.centre)
    fit = np.exp(-((baseline / target - 1) ** 2) / (2 * BASELINE_SPREAD**2))
    return np.where(seen & (angle >= LEAST_PARALLAX), fit * np.minimum(angle / settings.least_angle, 1.0), 0.0)


def mapping(view: Camera, other: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Where the pixels of a view fall in another, by inverse depth.

    A pixel (x, y, 1) of the view, at inverse depth i, falls at (u/w, v/w), where (u, v, w) = turn · (x, y, 1) +
    i · shift: K' R K⁻¹ (x, y, 1) + i K' t.

    Returns:
        (3, 3) turn and (3,) shift, float64.
    """
    relative = other.world_to_camera @ view.camera_to_world
    turn = other.intrinsic_matrix @ relative[:3, :3] @ np.linalg.inv(view.intrinsic_matrix)
    return turn, other.intrinsic_matrix @ relative[:3, 3]
