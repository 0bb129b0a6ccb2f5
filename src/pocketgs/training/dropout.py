"""Dropout where few photographs show the scene: there, Gaussians that explain single photographs together are common.

A step that leaves some out at random rewards those that also fit without the others (DropGaussian, Park et al. 2025).
Unlike there, the others' opacities are not raised to compensate, which does not help here; docs/recipe.md has figures.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pocketgs.geometry.camera import Camera
from pocketgs.scene.point_cloud import PointCloud
from pocketgs.splat.settings import Dropout

FEW_VIEWS = 8
"""Number of views up to which dropout has its full share."""

ENOUGH_VIEWS = 12
"""Number of views from which on there is no dropout: there it costs details, and gains little."""

MOST_POINTS = 10_000
"""Maximum number of points that the median is taken over."""


def views_per_point(cameras: Sequence[Camera], points: PointCloud) -> float:
    """Median over the points of the number of cameras whose image contains the point.

    Args:
        cameras: of the training views.
        points: of the scene.
    """
    positions = points.positions[:: 1 + len(points) // MOST_POINTS].astype(np.float64)
    views = np.zeros(len(positions))
    for camera in cameras:
        pixels, depth = camera.project(positions)
        views += camera.shows(pixels, depth)
    return float(np.median(views)) if len(views) else 0.0


def dropout_share(most: float, views: float) -> float:
    """The share of Gaussians that steps leave out.

    Args:
        most: share where few views show the scene.
        views: of a point, from `views_per_point`.
    """
    return most * min(max((ENOUGH_VIEWS - views) / (ENOUGH_VIEWS - FEW_VIEWS), 0.0), 1.0)


def dropout_of_step(share: float, iteration: int, seed: int) -> Dropout | None:
    """The dropout of an iteration, or None if the share is 0.

    Args:
        share: of the Gaussians.
        iteration: counted from 1.
        seed: random seed of the run.
    """
    return Dropout(share, (iteration + 0x9E3779B9 * seed) % 2**32) if share > 0.0 else None
