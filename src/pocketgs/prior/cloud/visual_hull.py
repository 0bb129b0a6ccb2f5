"""The visual hull of the silhouettes in images with alpha."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pocketgs.capture.capture import Frame


def outside_hull(points: np.ndarray, frames: Sequence[Frame]) -> np.ndarray:
    """Whether points project to transparent pixels of some image with alpha.

    Args:
        points: (M, 3) in the world.
        frames: those without alpha are ignored, and so are those that do not see a point.

    Returns:
        (M,) bool.
    """
    outside = np.zeros(len(points), bool)
    for frame in frames:
        if frame.alpha is None:
            continue
        pixels, depth = frame.camera.project(points)
        seen = (depth > 0) & frame.camera.contains(pixels)
        columns, rows = pixels[seen].astype(np.int64).T
        outside[seen] |= frame.alpha[rows, columns] == 0
    return outside
