"""A coloured point cloud."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pocketgs.errors import PocketGSError


@dataclass(frozen=True)
class PointCloud:
    """Points on the scene's surfaces.

    Attributes:
        positions: (N, 3) float32, in the world.
        colours: (N, 3) float32 RGB in [0, 1], display-referred.
        directions: (N, 3) float32 unit vectors towards the cameras that saw the points, or None.

    Raises:
        PocketGSError: the shapes disagree.
    """

    positions: np.ndarray
    colours: np.ndarray
    directions: np.ndarray | None = None

    def __post_init__(self) -> None:
        for name in ("positions", "colours", "directions"):
            if getattr(self, name) is None:
                continue
            array = np.ascontiguousarray(getattr(self, name), dtype=np.float32)
            object.__setattr__(self, name, array)
            if array.ndim != 2 or array.shape[1] != 3:
                raise PocketGSError(f"point cloud: {name} has shape {array.shape}, expected (N, 3)")
            if len(array) != len(self.positions):
                raise PocketGSError(f"point cloud: {len(self.positions)} positions but {len(array)} {name}")

    def __len__(self) -> int:
        return len(self.positions)

    def select(self, keep: np.ndarray) -> PointCloud:
        """The points that a boolean mask or an index array names."""
        directions = None if self.directions is None else self.directions[keep]
        return PointCloud(self.positions[keep], self.colours[keep], directions)
