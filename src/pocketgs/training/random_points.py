"""Random points in a cube, 3DGS's initialisation for captures without points."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pocketgs.geometry.camera import Camera
from pocketgs.geometry.camera_geometry import focus_point
from pocketgs.scene.point_cloud import PointCloud

HALF_SIDE = 1.3 / 4.03
"""Half side of the cube relative to the cameras' distance: 1.3 in NeRF-Synthetic's scenes, with cameras 4.03 away."""


def points_in_a_cube(cameras: Sequence[Camera], count: int, seed: int) -> PointCloud:
    """Draw randomly coloured points in a cube around the focus of the cameras.

    Args:
        cameras: of the training views.
        count: number of points.
        seed: random seed.
    """
    rng = np.random.default_rng(seed)
    middle = focus_point(cameras)
    distance = float(np.median([np.linalg.norm(camera.centre - middle) for camera in cameras]))
    positions = middle + HALF_SIDE * distance * rng.uniform(-1.0, 1.0, (count, 3))
    return PointCloud(positions.astype(np.float32), rng.uniform(size=(count, 3)).astype(np.float32))
