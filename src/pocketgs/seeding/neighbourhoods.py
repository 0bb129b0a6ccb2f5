"""Surfaces at points, from their nearest neighbours: the interface that the CPU and GPU versions implement."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from pocketgs.system.device import DeviceName

SPACING_NEIGHBOURS = 3
"""A seed's size is the mean distance to this many nearest neighbours (3DGS, section 4)."""

PLANE_NEIGHBOURS = 16
"""The surface at a point is the plane through this many nearest neighbours."""

MIN_POINTS = SPACING_NEIGHBOURS + 1


@dataclass(frozen=True)
class Neighbourhoods:
    """The surroundings of N points.

    Attributes:
        spacing: (N,) mean distance to the three nearest neighbours.
        normals, tangents: (N, 3) eigenvectors of the smallest and of the largest eigenvalue of the covariance of the
            point and its 16 nearest neighbours, C = 1/K Σ (p_k - p̄)(p_k - p̄)ᵀ.
    """

    spacing: np.ndarray
    normals: np.ndarray
    tangents: np.ndarray


class NeighbourSearch(Protocol):
    """Finds the nearest neighbours of points, exactly, on one device."""

    name: DeviceName

    @property
    def most_points(self) -> int:
        """The largest number of points that the device's memory holds."""

    def around(self, positions: np.ndarray) -> Neighbourhoods:
        """The neighbourhood of every point.

        Args:
            positions: (N, 3) float64, finite, N >= MIN_POINTS.
        """
