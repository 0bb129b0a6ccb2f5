"""Between which depths a keyframe's surfaces lie, as its sparse points tell."""

from __future__ import annotations

import numpy as np

from pocketgs.camera import Camera

QUANTILES = (0.05, 0.95)
NEARER, FARTHER = 0.7, 1.6
"""Factors that widen the range of the quantiles."""

FEWEST_POINTS = 20

UNKNOWN = (0.4, 4.0)
"""The range, in units of the distance to the scene, where there are too few points."""


def depth_range(camera: Camera, points: np.ndarray, distance: float) -> tuple[float, float]:
    """Nearest and farthest depth to search.

    Args:
        camera: of the keyframe.
        points: (N, 3) sparse points that it sees.
        distance: typical distance to the scene, for keyframes that see too few points.
    """
    depth = points @ camera.world_to_camera[2, :3] + camera.world_to_camera[2, 3]
    depth = depth[depth > 0]
    if len(depth) < FEWEST_POINTS:
        return UNKNOWN[0] * distance, UNKNOWN[1] * distance
    near, far = np.quantile(depth, QUANTILES)
    return NEARER * float(near), FARTHER * float(far)
