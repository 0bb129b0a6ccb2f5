"""Where points were seen: what triangulation and bundle adjustment work on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Observations:
    """M sightings of points in views.

    Attributes:
        frame: (M,) int32 index of the view.
        point: (M,) int32 index of the point.
        pixels: (M, 2) float64 where.
    """

    frame: np.ndarray
    point: np.ndarray
    pixels: np.ndarray

    def __len__(self) -> int:
        return len(self.point)

    def select(self, keep: np.ndarray) -> Observations:
        """The sightings that a boolean mask or an index array names; points keep their numbers."""
        return Observations(self.frame[keep], self.point[keep], self.pixels[keep])
