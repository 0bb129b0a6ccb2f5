"""A coloured point cloud."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from pocketgs.errors import PocketGSError


@dataclass(frozen=True)
class PointCloud:
    """Coloured points on the scene's surfaces.

    Attributes:
        positions: (N, 3) float64 in world coordinates: a file's may be far from the origin.
        colours: (N, 3) float32 RGB in [0, 1], display-referred.
        directions: (N, 3) float32 unit vectors from the points to the cameras that saw them, or None.
        confidences: (N,) float32 in [0, 1], or None.

    Raises:
        PocketGSError: the shapes disagree.
    """

    positions: np.ndarray
    colours: np.ndarray
    directions: np.ndarray | None = None
    confidences: np.ndarray | None = None

    def __post_init__(self) -> None:
        for name, array in self._arrays().items():
            array = np.ascontiguousarray(array, dtype=np.float64 if name == "positions" else np.float32)
            object.__setattr__(self, name, array)
            columns = () if name == "confidences" else (3,)
            if array.ndim != 1 + len(columns) or array.shape[1:] != columns:
                expected = f"(N{', 3' if columns else ','})"
                raise PocketGSError(f"point cloud: {name} has shape {array.shape}, expected {expected}")
            if len(array) != len(self.positions):
                raise PocketGSError(f"point cloud: {len(self.positions)} positions but {len(array)} {name}")

    def __len__(self) -> int:
        return len(self.positions)

    def select(self, keep: np.ndarray) -> PointCloud:
        """The points selected by a boolean mask or an index array."""
        return PointCloud(**{name: array[keep] for name, array in self._arrays().items()})

    def _arrays(self) -> dict[str, np.ndarray]:
        """The arrays that are not None, by name."""
        found = {field.name: getattr(self, field.name) for field in fields(self)}
        return {name: array for name, array in found.items() if array is not None}
