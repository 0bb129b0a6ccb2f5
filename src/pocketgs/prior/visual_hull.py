"""The visual hull: what lies inside the silhouettes that images with alpha show."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pocketgs.capture.capture import Frame


def outside_hull(points: np.ndarray, frames: Sequence[Frame]) -> np.ndarray:
    """Which points fall where some image with alpha shows nothing.

    Args:
        points: (M, 3) in the world.
        frames: those without alpha have no say, and neither have those that do not see a point.

    Returns:
        (M,) bool.
    """
    outside = np.zeros(len(points), bool)
    for frame in frames:
        if frame.alpha is None:
            continue
        pixels, depth = frame.camera.project(points)
        height, width = frame.alpha.shape
        seen = (depth > 0) & np.all((pixels >= 0) & (pixels < (width, height)), axis=1)
        columns, rows = pixels[seen].astype(np.int64).T
        outside[seen] |= frame.alpha[rows, columns] == 0
    return outside
