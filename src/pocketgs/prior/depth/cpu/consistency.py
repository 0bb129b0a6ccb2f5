"""Comparison of depth maps: each depth of one view with the depth maps of the others."""

from __future__ import annotations

import numpy as np
from numba import prange

from pocketgs.prior.depth.consistency import AROUND, COHERENT_STEPS, CONFIRMED, SweptViews, farthest_confirmed
from pocketgs.system.compile import parallel_kernel, part


def compare_depths(views: SweptViews, view: int, tolerance: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Compare every depth of a view with the other views' depths.

    See `pocketgs.prior.depth.stereo.Stereo.compare`.

    Args:
        views: all views.
        view: index of the view.
        tolerance: maximum relative difference of agreeing depths.

    Returns:
        The fields of `Agreement`.
    """
    return _compare(views, view, tolerance, farthest_confirmed(views, view))


@parallel_kernel
def _compare(
    views: SweptViews, view: int, tolerance: float, farthest: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """See `compare_depths`; `farthest`: (K,) depths up to which the agreement of each view counts."""
    height, width = views.sizes[view]
    agreeing, contradicting = np.zeros((2, height, width), np.uint16)
    footprints = np.zeros((height, width), np.float32)
    fx, fy, cx, cy = views.intrinsics[view]
    turns, shifts = relative_poses(views, view)
    for row in prange(height):
        for column in range(width):
            depth = np.float64(views.depths[view, row, column])
            if depth <= 0:
                continue
            x, y = (column + 0.5 - cx) / fx * depth, (row + 0.5 - cy) / fy * depth
            footprint = depth / fx
            for other in range(len(views.depths)):
                turn, shift = turns[other], shifts[other]
                z = turn[2, 0] * x + turn[2, 1] * y + turn[2, 2] * depth + shift[2]
                if other == view or z <= 0:
                    continue
                focal_x, focal_y, centre_x, centre_y = views.intrinsics[other]
                u = focal_x * (turn[0, 0] * x + turn[0, 1] * y + turn[0, 2] * depth + shift[0]) / z + centre_x
                v = focal_y * (turn[1, 0] * x + turn[1, 1] * y + turn[1, 2] * depth + shift[1]) / z + centre_y
                if u < 0 or v < 0 or u >= views.sizes[other, 1] or v >= views.sizes[other, 0]:
                    continue
                theirs = views.depths[other, int(v), int(u)]
                if theirs <= 0:
                    continue
                step = max(views.steps[view], views.steps[other])
                indistinct = max(0.5, min(1.0, step * z)) * step * z * theirs
                if abs(z - theirs) < max(tolerance * z, indistinct):
                    if depth <= farthest[other]:
                        agreeing[row, column] += 1
                        footprint = min(footprint, z / focal_x)
                elif z < theirs:
                    contradicting[row, column] += 1
            if agreeing[row, column] < CONFIRMED and not is_coherent(
                views.depths[view, :height, :width], row, column, views.steps[view]
            ):
                contradicting[row, column] += 1
            footprints[row, column] = footprint
    return agreeing, contradicting, footprints


@part
def is_coherent(depths: np.ndarray, row: int, column: int, step: float) -> bool:
    """Whether at least half of the known depths around a pixel, its own included, are about the same as its own.

    Inverse depths 1/a and 1/b are compared as |a - b| ≤ s a b, without a division, whose rounding devices differ in.
    """
    height, width = depths.shape
    here, tolerance = depths[row, column], np.float32(COHERENT_STEPS * step)
    close, known = 0, 0
    for i in range(max(row - AROUND, 0), min(row + AROUND + 1, height)):
        for j in range(max(column - AROUND, 0), min(column + AROUND + 1, width)):
            there = depths[i, j]
            if there > 0:
                known += 1
                close += abs(there - here) <= tolerance * here * there
    return 2 * close >= known


@part
def relative_poses(views: SweptViews, view: int) -> tuple[np.ndarray, np.ndarray]:
    """(K, 3, 3) and (K, 3): transforms from one view's camera axes to each view's."""
    count = len(views.rotations)
    turns, shifts = np.zeros((count, 3, 3)), np.zeros((count, 3))
    for other in range(count):
        for i in range(3):
            for j in range(3):
                for k in range(3):
                    turns[other, i, j] += views.rotations[other, i, k] * views.rotations[view, j, k]
            shifts[other, i] = views.translations[other, i]
            for j in range(3):
                shifts[other, i] -= turns[other, i, j] * views.translations[view, j]
    return turns, shifts
