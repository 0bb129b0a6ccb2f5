"""Nearest neighbours on the CPU."""

from __future__ import annotations

import sys

import numpy as np
from scipy.spatial import cKDTree

from pocketgs.seeding.neighbourhoods import PLANE_NEIGHBOURS, SPACING_NEIGHBOURS, Neighbourhoods
from pocketgs.system.cores import usable_cores
from pocketgs.system.device import DeviceName


class CpuSearch:
    """See `pocketgs.seeding.neighbourhoods.NeighbourSearch`."""

    name: DeviceName = "cpu"
    most_points = sys.maxsize

    def around(self, positions: np.ndarray) -> Neighbourhoods:
        """The neighbourhood of every point."""
        tree = cKDTree(positions)
        count = min(PLANE_NEIGHBOURS + 1, len(positions))
        distances, neighbours = tree.query(positions, k=count, workers=usable_cores())
        around = positions[neighbours]
        around -= around.mean(axis=1, keepdims=True)
        _, axes = np.linalg.eigh(around.transpose(0, 2, 1) @ around / count)
        return Neighbourhoods(distances[:, 1 : SPACING_NEIGHBOURS + 1].mean(axis=1), axes[:, :, 0], axes[:, :, 2])
