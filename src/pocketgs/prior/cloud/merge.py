"""Merging: from millions of pixels with depths to a point cloud of bounded size."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pocketgs.scene.point_cloud import PointCloud

MERGING_ROUNDS = 12
OVERFULL = 1.05
"""Maximum ratio of filled voxels to requested points: the voxels of least weight are dropped."""

DETAIL_POWER = 2 / 3
MAX_OCTAVES = 1.5
"""Voxel sides shrink with this power of the detail, by up to this many octaves from the median detail."""

MIN_DETAIL = 1e-4
"""Lower bound of the detail: photographs are rounded to 1/255."""

STEPS_AN_OCTAVE = 2

SIZES_AN_OCTAVE = 64
"""Voxel sizes are tried in steps of 2^(1/64): devices whose depths differ in a few pixels then find the same voxels."""

KEY_FACTORS = (0x9E3779B97F4A7C15, 0xBF58476D1CE4E5B9, 0x94D049BB133111EB, 0xD6E8FEB86659FD93)
"""A voxel's key is the sum, modulo 2^64, of its place and relative level times these odd numbers without a pattern.

Two voxels have one key only if their difference times the factors is 0, which no difference of some thousand cells is
likely to give. Exclusive or would not do in place of the sum: cells on opposite sides of an axis would have one key.
Levels count from the lowest, so that the order of keys, which decides between equally heavy voxels, does not depend on
the unit of length.
"""


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


def merged(candidates: Candidates, count: int) -> PointCloud:
    """Average the candidates in each voxel; the voxel size is chosen so that about `count` voxels are filled.

    A voxel's side is proportional to the footprints of the pixels in it, and shrinks with their detail: a bounded
    number of Gaussians is most useful where there is detail. Both are rounded to steps of √2.

    Args:
        candidates: to merge.
        count: maximum number of points.

    Returns:
        At most `count` points, with their directions and the mean confidence of their pixels; dense where many pixels
        see a detailed surface.
    """
    if len(candidates.positions) == 0:
        return PointCloud(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0))
    level = _levels(candidates)
    size = 2.0
    for _ in range(MERGING_ROUNDS):
        _, voxel = np.unique(_voxels(candidates.positions, level, size), return_inverse=True)
        filled = int(voxel.max()) + 1
        if count <= filled <= OVERFULL * count or (filled < count and filled == len(voxel)):
            break
        # The number of voxels on a surface grows with the square of the resolution.
        size *= np.sqrt(filled / ((1 + OVERFULL) / 2 * count))
        size = np.exp2(np.round(SIZES_AN_OCTAVE * np.log2(size)) / SIZES_AN_OCTAVE)
    weight = np.bincount(voxel, candidates.confidences)

    def mean(values: np.ndarray) -> np.ndarray:
        weighted = values * candidates.confidences[:, None]
        return np.stack([np.bincount(voxel, column) for column in weighted.T], axis=1) / weight[:, None]

    directions = mean(candidates.directions)
    directions /= np.maximum(np.linalg.norm(directions, axis=1, keepdims=True), 1e-9)
    confidences = weight / np.bincount(voxel)
    cloud = PointCloud(mean(candidates.positions), mean(candidates.colours), directions, confidences)
    return cloud if len(cloud) <= count else cloud.select(np.sort(np.argsort(-weight, kind="stable")[:count]))


def _levels(candidates: Candidates) -> np.ndarray:
    """(M,) int64 logarithm of the voxels' relative sides, in steps of √2."""
    details = np.maximum(candidates.details.astype(np.float64), MIN_DETAIL)
    octaves = -DETAIL_POWER * np.log2(details / np.median(details))
    octaves = np.log2(candidates.footprints.astype(np.float64)) + np.clip(octaves, -MAX_OCTAVES, MAX_OCTAVES)
    return np.round(STEPS_AN_OCTAVE * octaves).astype(np.int64)


def _voxels(positions: np.ndarray, level: np.ndarray, size: float) -> np.ndarray:
    """(M,) int64 key of each voxel, see `KEY_FACTORS`."""
    cells = np.floor(positions / (size * np.exp2(level / STEPS_AN_OCTAVE))[:, None]).astype(np.int64)
    factors = np.array(KEY_FACTORS, np.uint64).view(np.int64)
    return cells @ factors[:3] + (level - level.min()) * factors[3]
