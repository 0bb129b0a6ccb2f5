"""Importance of Gaussians, for pruning."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
from scipy.spatial import cKDTree

from pocketgs.capture.even_choice import evenly_chosen
from pocketgs.geometry.camera import Camera
from pocketgs.scene.gaussians import Gaussians
from pocketgs.splat.rasterizer import Rasterizer
from pocketgs.system.cores import usable_cores

Importance = Literal["contribution", "distinct"]

NEIGHBOURS = 8
"""Number of neighbours for the comparison of colours."""

VIEWS = 60
"""Maximum number of views for contributions."""


def importance(
    scene: Gaussians, cameras: Sequence[Camera], rasterizer: Rasterizer, measure: Importance = "contribution"
) -> np.ndarray:
    """(N,) importance of each Gaussian; only the order is meaningful.

    Args:
        scene: the Gaussians.
        cameras: the views.
        rasterizer: of any engine.
        measure: "contribution" is the geometric mean of the sum of α T over all pixels of the views, which is large for
            large Gaussians, and the largest α T of a pixel, which is large for details; "distinct" multiplies it by the
            difference of the colour from the neighbours' (OMG, Lee et al. 2025).
    """
    summed, largest = contributions(scene, cameras, rasterizer)
    found = np.sqrt(summed * largest)
    return found * _distinctness(scene) if measure == "distinct" else found


def contributions(scene: Gaussians, cameras: Sequence[Camera], rasterizer: Rasterizer) -> tuple[np.ndarray, np.ndarray]:
    """(N,) sum of α T over all pixels of the views, and (N,) its largest value on one pixel."""
    summed, largest = np.zeros(len(scene)), np.zeros(len(scene), np.float32)
    chosen = [cameras[place] for place in evenly_chosen(len(cameras), VIEWS)]
    for found in rasterizer.contributions(scene, chosen):
        summed += found.summed
        largest = np.maximum(largest, found.largest)
    return summed, largest


def _distinctness(scene: Gaussians) -> np.ndarray:
    """(N,) mean absolute difference of a Gaussian's colour from those of its nearest neighbours."""
    count = min(NEIGHBOURS + 1, len(scene))
    _, neighbours = cKDTree(scene.means).query(scene.means, k=count, workers=usable_cores())
    colours = scene.sh[:, 0]
    apart = np.abs(colours[:, None] - colours[neighbours.reshape(len(scene), count)])
    return np.asarray(apart.sum(axis=2).mean(axis=1))
