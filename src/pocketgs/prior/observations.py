"""Where points were seen: what triangulation and bundle adjustment work on."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

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


def enough_for_each_view(observations: Observations, views: int, most: int) -> np.ndarray:
    """(M,) bool: the sightings of so many points that every view sees `most` of them, if it sees as many.

    Points that most views see come first.

    Args:
        observations: in any order.
        views: their number.
        most: points that are enough for a view.
    """
    seen = np.bincount(observations.point, minlength=1)
    order = np.lexsort((observations.point, -seen[observations.point]))
    frame, point = observations.frame[order], observations.point[order]
    have, wanted = np.zeros(views, np.int64), np.zeros(len(seen), bool)
    for first, end in pairwise(np.flatnonzero(np.diff(point, prepend=-1, append=-1))):
        seeing = frame[first:end]
        if have[seeing].min() < most:
            wanted[point[first]] = True
            have[seeing] += 1
    return wanted[observations.point]
