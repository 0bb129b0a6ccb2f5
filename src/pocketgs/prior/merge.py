"""Merging: from millions of pixels with depths to as many points as a scene may have Gaussians."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pocketgs.scene.point_cloud import PointCloud

MERGING_ROUNDS = 12
OVERFULL = 1.05
"""Voxels filled for each point asked for, at most: the lightest are left out."""

DETAIL_POWER = 2 / 3
MAX_OCTAVES = 1.5
"""Voxels' sides fall with this power of the detail, up to so many octaves from that of the median detail."""

MIN_DETAIL = 1e-4
"""Less than this is taken for this: photographs are rounded to 1/255."""

STEPS_AN_OCTAVE = 2


@dataclass(frozen=True)
class Candidates:
    """Pixels that may become points.

    Attributes:
        positions: (M, 3) in the world.
        colours: (M, 3) RGB in [0, 1].
        directions: (M, 3) unit vectors towards the camera.
        footprints: (M,) length that a pixel covers there, in the nearest view that sees the point.
        details: (M,) local contrast in [0, 1], see `pocketgs.prior.detail`.
        confidences: (M,) in [0, 1].
    """

    positions: np.ndarray
    colours: np.ndarray
    directions: np.ndarray
    footprints: np.ndarray
    details: np.ndarray
    confidences: np.ndarray

    def select(self, keep: np.ndarray) -> Candidates:
        """Those that a boolean mask names."""
        return Candidates(
            self.positions[keep],
            self.colours[keep],
            self.directions[keep],
            self.footprints[keep],
            self.details[keep],
            self.confidences[keep],
        )


def merged(candidates: Candidates, count: int) -> PointCloud:
    """Average the candidates of each voxel; voxels are so large that about `count` are filled.

    A voxel's side is a multiple of the footprints of the pixels in it, and falls with the detail they show:
    a bounded number of Gaussians does most where there is most to show. Both are rounded, to steps of the root of two.

    Args:
        candidates: what to merge.
        count: most points to give.

    Returns:
        At most `count` points, with their directions and the mean confidence of their pixels; dense where many pixels
        see the surface, and where they see much on it.
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
        # Surfaces fill voxels with the square of their number along a side.
        size *= np.sqrt(filled / ((1 + OVERFULL) / 2 * count))
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
    """(M,) int64 logarithm of the voxels' relative sides, in steps of the root of two."""
    details = np.maximum(candidates.details, MIN_DETAIL)
    octaves = -DETAIL_POWER * np.log2(details / np.median(details))
    octaves = np.log2(candidates.footprints) + np.clip(octaves, -MAX_OCTAVES, MAX_OCTAVES)
    return np.round(STEPS_AN_OCTAVE * octaves).astype(np.int64)


def _voxels(positions: np.ndarray, level: np.ndarray, size: float) -> np.ndarray:
    """(M,) int64 one number a voxel; two voxels that share one by chance are too rare to matter."""
    cells = np.floor(positions / (size * np.exp2(level / STEPS_AN_OCTAVE))[:, None]).astype(np.int64)
    return (cells[:, 0] * 73856093 ^ cells[:, 1] * 19349663 ^ cells[:, 2] * 83492791) * 64 + level
