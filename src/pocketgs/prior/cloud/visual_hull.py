"""The visual hull of the silhouettes in images with alpha."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pocketgs.capture.capture import Frame

JUDGING_POINTS = 10_000
"""Number of points, at most, on which silhouettes are compared with each other: more take time and tell the same."""


def outside_hull(points: np.ndarray, frames: Sequence[Frame]) -> np.ndarray:
    """Whether points project to transparent pixels of some image with alpha.

    Args:
        points: (M, 3) in the world.
        frames: those without alpha are ignored, and so are those that do not see a point, and those that lost the
            object when they were cut out.

    Returns:
        (M,) bool.
    """
    some = points[:: 1 + len(points) // JUDGING_POINTS]
    outside = np.zeros(len(points), bool)
    for frame in _with_the_object([frame for frame in frames if frame.alpha is not None], some):
        left = np.flatnonzero(~outside)
        outside[left] = _seen_and_transparent(frame, points[left])[1]
    return outside


def _with_the_object(frames: Sequence[Frame], points: np.ndarray) -> list[Frame]:
    """Frames whose cut-out kept the object: opaque at half or more of the points where most frames are.

    One whose background removal took the object too would empty the whole cloud.
    """
    seen, transparent = np.zeros((2, len(frames), len(points)), bool)
    for index, frame in enumerate(frames):
        seen[index], transparent[index] = _seen_and_transparent(frame, points)
    shown = 2 * transparent.sum(axis=0) < seen.sum(axis=0)
    lost = 2 * (transparent & shown).sum(axis=1) > (seen & shown).sum(axis=1)
    return [frame for frame, without in zip(frames, lost, strict=True) if not without]


def _seen_and_transparent(frame: Frame, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(M,) bool each: which points a frame with alpha has in view, and which of those at transparent pixels."""
    assert frame.alpha is not None
    pixels, depth = frame.camera.project(points)
    seen = frame.camera.shows(pixels, depth)
    transparent = np.zeros(len(points), bool)
    columns, rows = pixels[seen].astype(np.int64).T
    transparent[seen] = frame.alpha[rows, columns] == 0
    return seen, transparent
