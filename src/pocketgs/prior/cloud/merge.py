"""Merging: from millions of pixels with depths to a point cloud of bounded size; `Merger` is the interface that the CPU
and GPU versions implement.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.spatial.transform import Rotation

from pocketgs.scene.point_cloud import PointCloud
from pocketgs.system.device import DeviceName

MERGING_ROUNDS = 12
"""Trials of the voxels' size until their number is right."""

OVERFULL = 1.05
"""Maximum ratio of filled voxels to requested points: the voxels of least weight are dropped."""

DETAIL_POWER = 2 / 3
MAX_OCTAVES = 1.5
"""Voxel sides shrink with this power of the detail, by up to this many octaves from the median detail."""

MIN_DETAIL = 1e-4
"""Lower bound of the detail: photographs are rounded to 1/255."""

STEPS_AN_OCTAVE = 2

TURN = Rotation.from_euler("xyz", (0.5, 0.7, 0.3)).as_matrix()
"""The grid of voxels is turned against the world.

Walls and floors are often parallel to the world's axes. Where the side of a voxel ran along one, its pixels, a little
before and behind it, would give two sheets of points in place of one: 88 to 92 % of the demo's points were within 1 %
of the surface, according to where the sides lay. With the grid turned, 92 % are, wherever it begins: no side of a voxel
is within 20 degrees of a wall along the axes.
"""

SIZES_AN_OCTAVE = 64
"""Voxel sizes are tried in steps of 2^(1/64): devices whose depths differ in a few pixels then find the same voxels."""


@dataclass(frozen=True)
class Candidates:
    """Pixels that may become points.

    Attributes:
        positions: (M, 3) in the world.
        colours: (M, 3) RGB in [0, 1].
        directions: (M, 3) unit vectors towards the camera.
        footprints: (M,) footprint of a pixel there, in the nearest view that sees the point.
        details: (M,) local contrast in [0, 1], see `pocketgs.prior.cloud.detail`.
        confidences: (M,) in [0, 1].
    """

    positions: np.ndarray
    colours: np.ndarray
    directions: np.ndarray
    footprints: np.ndarray
    details: np.ndarray
    confidences: np.ndarray

    def select(self, keep: np.ndarray) -> Candidates:
        """The candidates selected by a boolean mask."""
        return Candidates(
            self.positions[keep],
            self.colours[keep],
            self.directions[keep],
            self.footprints[keep],
            self.details[keep],
            self.confidences[keep],
        )


class Merger(Protocol):
    """Brings candidates together, on one device."""

    name: DeviceName

    def merged(self, candidates: Candidates, count: int) -> PointCloud:
        """Average the candidates in each voxel; the voxel size is chosen so that about `count` voxels are filled.

        A voxel's side is proportional to the footprints of the pixels in it, and shrinks with their detail: a bounded
        number of Gaussians is most useful where there is detail. Both are rounded to steps of √2.

        Args:
            candidates: to merge.
            count: maximum number of points.

        Returns:
            At most `count` points, with their directions and the mean confidence of their pixels; dense where many
            pixels see a detailed surface.
        """


def choose_size(filled: Callable[[float], int], candidates: int, count: int) -> tuple[float, int]:
    """Choose the voxels' size.

    Args:
        filled: number of voxels of a size that have a candidate. It is asked for the chosen size last.
        candidates: their number.
        count: maximum number of points.

    Returns:
        The size, in levels' sides, and the number of voxels that it fills.
    """
    size, tried, found = 2.0, 0.0, 0
    for _ in range(MERGING_ROUNDS):
        tried, found = size, filled(size)
        if count <= found <= OVERFULL * count or (found < count and found == candidates):
            break
        # The number of voxels on a surface grows with the square of the resolution.
        size *= np.sqrt(found / ((1 + OVERFULL) / 2 * count))
        size = float(np.exp2(np.round(SIZES_AN_OCTAVE * np.log2(size)) / SIZES_AN_OCTAVE))
    return tried, found


def turned(positions: np.ndarray) -> np.ndarray:
    """(M, 3) float64 positions along the axes of the grid. Sums have one order, so that all hosts get the same bits."""
    x, y, z = positions.astype(np.float64).T
    return np.stack([row[0] * x + row[1] * y + row[2] * z for row in TURN], axis=1)


def levels_of(candidates: Candidates) -> np.ndarray:
    """(M,) int64 logarithm of the voxels' relative sides, in steps of √2."""
    details = np.maximum(candidates.details.astype(np.float64), MIN_DETAIL)
    octaves = -DETAIL_POWER * np.log2(details / np.median(details))
    octaves = np.log2(candidates.footprints.astype(np.float64)) + np.clip(octaves, -MAX_OCTAVES, MAX_OCTAVES)
    return np.round(STEPS_AN_OCTAVE * octaves).astype(np.int64)


def side_of(levels: np.ndarray, size: float) -> np.ndarray:
    """Sides of voxels, in scene units."""
    return np.asarray(size * np.exp2(levels / STEPS_AN_OCTAVE))


def heaviest(cloud: PointCloud, weight: np.ndarray, count: int) -> PointCloud:
    """At most `count` points, those of largest weight, in their order."""
    return cloud if len(cloud) <= count else cloud.select(np.sort(np.argsort(-weight, kind="stable")[:count]))
