"""Merging on the CPU."""

from __future__ import annotations

import numpy as np

from pocketgs.prior.cloud.merge import Candidates, choose_size, heaviest, levels_of, side_of, turned
from pocketgs.scene.point_cloud import PointCloud
from pocketgs.system.device import DeviceName

KEY_FACTORS = (0x9E3779B97F4A7C15, 0xBF58476D1CE4E5B9, 0x94D049BB133111EB, 0xD6E8FEB86659FD93)
"""A voxel's key is the sum, modulo 2^64, of its place and relative level times these odd numbers without a pattern.

Two voxels have one key only if their difference times the factors is 0, which no difference of some thousand cells is
likely to give. Exclusive or would not do in place of the sum: cells on opposite sides of an axis would have one key.
Levels count from the lowest, so that the order of keys, which decides between equally heavy voxels, does not depend on
the unit of length.
"""


class CpuMerger:
    """See `pocketgs.prior.cloud.merge.Merger`."""

    name: DeviceName = "cpu"

    def merged(self, candidates: Candidates, count: int) -> PointCloud:
        """Average the candidates in each voxel."""
        if len(candidates.positions) == 0:
            return PointCloud(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0))
        level = levels_of(candidates)
        along_grid, voxel = turned(candidates.positions), np.zeros(0, np.int64)

        def filled(size: float) -> int:
            nonlocal voxel
            _, voxel = np.unique(_voxels(along_grid, level, size), return_inverse=True)
            return int(voxel.max()) + 1

        choose_size(filled, len(level), count)
        weight = np.bincount(voxel, candidates.confidences)

        def mean(values: np.ndarray) -> np.ndarray:
            weighted = values * candidates.confidences[:, None]
            return np.stack([np.bincount(voxel, column) for column in weighted.T], axis=1) / weight[:, None]

        directions = mean(candidates.directions)
        directions /= np.maximum(np.linalg.norm(directions, axis=1, keepdims=True), 1e-9)
        confidences = weight / np.bincount(voxel)
        cloud = PointCloud(mean(candidates.positions), mean(candidates.colours), directions, confidences)
        return heaviest(cloud, weight, count)


def _voxels(positions: np.ndarray, level: np.ndarray, size: float) -> np.ndarray:
    """(M,) int64 key of each voxel, see `KEY_FACTORS`. Positions are along the axes of the grid."""
    cells = np.floor(positions / side_of(level, size)[:, None]).astype(np.int64)
    factors = np.array(KEY_FACTORS, np.uint64).view(np.int64)
    return cells @ factors[:3] + (level - level.min()) * factors[3]
