"""Clusters: runs of Gaussians in memory, skipped as a whole if their bounds are outside the view.

If Gaussians that are neighbours in space are neighbours in memory (`morton_order`), most clusters are outside a view of
a part of the scene. Any other order gives the same results, more slowly.
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from pocketgs.scene.gaussians import Gaussians
from pocketgs.splat.constants import FRUSTUM_MARGIN, LOW_PASS
from pocketgs.splat.cpu.layout import CLUSTER, View
from pocketgs.splat.cpu.lenses.clusters import REACH, outside_cone, outside_parallel
from pocketgs.splat.cpu.lenses.lens import KernelLens, Orthographic, Pinhole
from pocketgs.system.compile import parallel_kernel
from pocketgs.system.dealing import first_piece, take

_LOW, _HIGH, _LOG_SCALE = 0, 3, 6
BOUNDS = 7
"""A cluster's bounds: minimum and maximum of its means, and its largest log scale."""


class Clusters:
    """The clusters of a scene.

    Args:
        count: number of Gaussians.
    """

    def __init__(self, count: int) -> None:
        self.all = np.arange(-(-count // CLUSTER), dtype=np.int32)
        self._bounds = np.empty((len(self.all), BOUNDS), np.float32)
        self._moved = self.all

    @property
    def nbytes(self) -> int:
        """Bytes of the bounds."""
        return self._bounds.nbytes

    def have_moved(self, clusters: np.ndarray) -> None:
        """Mark clusters whose Gaussians have changed since the last view; all others must be unchanged."""
        self._moved = clusters

    def in_view(self, scene: Gaussians, view: View, lens: KernelLens, near: float, threads: int) -> np.ndarray:
        """(M,) int32 ascending indices of the clusters that may be visible."""
        fit(scene.means, scene.log_scales, self._moved, threads, self._bounds)
        self._moved = self.all[:0]
        return np.flatnonzero(~outside(self._bounds, view, lens, near)).astype(np.int32)


def outside(bounds: np.ndarray, view: View, lens: KernelLens, near: float) -> np.ndarray:
    """(M,) bool: clusters without visible Gaussians.

    With r the reach and σ the largest standard deviation, a Gaussian at camera-space (x, y, z) extends to the right at
    most to f x/z + c + r (f/z √(1 + s²) σ + √0.3), where s is the largest slope at which its Jacobian is evaluated. If
    that is left of the first pixel's centre, its product with z is a linear function of the mean that is below 0; over
    a box it is largest at a corner. This holds for pinhole cameras; see `lenses/clusters.py` for others.

    Args:
        bounds: (M, BOUNDS).
        view: the camera.
        lens: of the camera.
        near: minimum depth of drawn Gaussians.
    """
    low, high = bounds[:, _LOW:_HIGH].astype(np.float64), bounds[:, _HIGH:_LOG_SCALE].astype(np.float64)
    # Non-finite bounds are never outside: comparisons with NaN are false.
    with np.errstate(all="ignore"):
        centres = 0.5 * (low + high) - view.centre
        halves = 0.5 * (high - low)
        sigma = np.exp(bounds[:, _LOG_SCALE].astype(np.float64))
        rotation = view.rotation
        if isinstance(lens, Orthographic):
            return outside_parallel(centres, halves, sigma, view, near)
        if not isinstance(lens, Pinhole):
            return outside_cone(centres, halves, sigma, view, lens, near)

        def largest(normal: np.ndarray) -> np.ndarray:
            return np.asarray(centres @ normal + halves @ np.abs(normal))

        found = largest(rotation[2]) < near
        sides = ((0, view.fx, view.cx, view.width), (1, view.fy, view.cy, view.height))
        for axis, focal, centre, size in sides:
            margin = FRUSTUM_MARGIN * size
            slope = max(centre + margin, size - centre + margin) / focal
            spread = REACH * focal * math.sqrt(1.0 + slope * slope) * sigma
            blur = REACH * math.sqrt(LOW_PASS) + 0.5
            before = focal * rotation[axis] + (centre + blur) * rotation[2]
            behind = -focal * rotation[axis] + (size - centre + blur) * rotation[2]
            found |= (largest(before) + spread < 0.0) | (largest(behind) + spread < 0.0)
    return np.asarray(found)


@parallel_kernel
def fit(means: np.ndarray, log_scales: np.ndarray, clusters: np.ndarray, threads: int, bounds: np.ndarray) -> None:
    """Compute the bounds of some clusters. Gaussians with NaN are ignored; a cluster with infinity is always in view.

    Args:
        means: (N, 3) float32.
        log_scales: (N, 3) float32.
        clusters: (M,) int32 indices.
        threads: number of threads.
        bounds: (clusters, BOUNDS) float32, written.
    """
    counter = first_piece()
    for _ in prange(threads):
        place = take(counter)
        while place < len(clusters):
            first = clusters[place] * CLUSTER
            own = bounds[clusters[place]]
            own[_LOW:_HIGH], own[_HIGH:] = np.inf, -np.inf
            for i in range(first, min(first + CLUSTER, len(means))):
                for k in range(3):
                    if means[i, k] < own[_LOW + k]:
                        own[_LOW + k] = means[i, k]
                    if means[i, k] > own[_HIGH + k]:
                        own[_HIGH + k] = means[i, k]
                    if log_scales[i, k] > own[_LOG_SCALE]:
                        own[_LOG_SCALE] = log_scales[i, k]
            place = take(counter)


@parallel_kernel
def clear(rows: np.ndarray, clusters: np.ndarray, threads: int) -> None:
    """Set the (N, C) rows of some clusters to 0."""
    counter = first_piece()
    for _ in prange(threads):
        place = take(counter)
        while place < len(clusters):
            first = clusters[place] * CLUSTER
            rows[first : first + CLUSTER] = 0.0
            place = take(counter)
