"""Observations of points in views, the input of triangulation and bundle adjustment."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np


@dataclass(frozen=True)
class Observations:
    """M observations of points in views.

    Attributes:
        frame: (M,) int32 index of the view.
        point: (M,) int32 index of the point.
        pixels: (M, 2) float64 positions.
    """

    frame: np.ndarray
    point: np.ndarray
    pixels: np.ndarray

    @classmethod
    def in_one_view(cls, pixels: np.ndarray) -> Observations:
        """Observations of as many points in a single view, at (M, 2) pixels."""
        point = np.arange(len(pixels), dtype=np.int32)
        return cls(np.zeros_like(point), point, pixels)

    def __len__(self) -> int:
        return len(self.point)

    def select(self, keep: np.ndarray) -> Observations:
        """The observations selected by a boolean mask or an index array; points keep their numbers."""
        return Observations(self.frame[keep], self.point[keep], self.pixels[keep])

    def renumbered(self) -> Observations:
        """The same observations, with their points numbered from 0 in the same order."""
        _, point = np.unique(self.point, return_inverse=True)
        return Observations(self.frame, point.astype(np.int32), self.pixels)


def enough_for_each_view(observations: Observations, views: int, most: int) -> np.ndarray:
    """(M,) bool: the observations of a subset of points, such that every view sees `most` of them if it can.

    Points seen by most views come first.

    Args:
        observations: in any order.
        views: number of views.
        most: points per view that are enough.
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
