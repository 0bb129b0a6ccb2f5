"""Planes, balls and cubes that rays can hit: the geometry of the demo scene.

Points, ray origins and ray directions are (3, N) float32, x, y, z in rows; (3, 1) stands for N times the same.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

Material = Callable[[np.ndarray], np.ndarray]


class Surface(Protocol):
    """Something a ray can hit."""

    def hit(self, origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
        """(N,) least t > 0 at which origins + t·directions enters the surface from outside, inf where none does."""

    def normals(self, points: np.ndarray) -> np.ndarray:
        """(3, N) outward unit normals at points on the surface."""

    def colours(self, points: np.ndarray) -> np.ndarray:
        """(3, N) RGB in [0, 1] of points on the surface."""


@dataclass(frozen=True)
class Plane:
    """An endless plane through `origin` (3, 1), solid behind its unit normal (3, 1)."""

    origin: np.ndarray
    normal: np.ndarray
    material: Material

    def hit(self, origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
        """See `Surface.hit`."""
        height, approach = _dot(origins - self.origin, self.normal), -_dot(directions, self.normal)
        ahead = (approach > 0) & (height > 0)
        return np.where(ahead, height / np.where(ahead, approach, 1), np.inf)

    def normals(self, points: np.ndarray) -> np.ndarray:
        """See `Surface.normals`."""
        return np.broadcast_to(self.normal, points.shape)

    def colours(self, points: np.ndarray) -> np.ndarray:
        """See `Surface.colours`."""
        return self.material(points - self.origin)


@dataclass(frozen=True)
class Ball:
    """A ball about `origin` (3, 1)."""

    origin: np.ndarray
    radius: float
    material: Material

    def hit(self, origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
        """See `Surface.hit`."""
        offset = origins - self.origin
        square, halfway = _dot(directions, directions), _dot(offset, directions)
        discriminant = halfway**2 - square * (_dot(offset, offset) - self.radius**2)
        distance = (-halfway - np.sqrt(np.maximum(discriminant, 0))) / square
        return np.where((discriminant > 0) & (distance > 0), distance, np.inf)

    def normals(self, points: np.ndarray) -> np.ndarray:
        """See `Surface.normals`."""
        return (points - self.origin) / self.radius

    def colours(self, points: np.ndarray) -> np.ndarray:
        """See `Surface.colours`."""
        return self.material(points - self.origin)


@dataclass(frozen=True)
class Cube:
    """A cube about `origin` (3, 1); the rows of `axes` (3, 3) are its own axes, which the material turns with."""

    origin: np.ndarray
    half_size: float
    axes: np.ndarray
    material: Material

    def hit(self, origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
        """See `Surface.hit`; the meeting of three slabs (Kay and Kajiya, 1986)."""
        start, heading = self.axes @ (origins - self.origin), self.axes @ directions
        heading = np.where(np.abs(heading) > 1e-9, heading, 1e-9)
        middle, reach = -start / heading, self.half_size / np.abs(heading)
        enters, leaves = (middle - reach).max(axis=0), (middle + reach).min(axis=0)
        return np.where((enters < leaves) & (enters > 0), enters, np.inf)

    def normals(self, points: np.ndarray) -> np.ndarray:
        """See `Surface.normals`."""
        local = self.axes @ (points - self.origin)
        face = np.argmax(np.abs(local), axis=0)
        return self.axes.T[:, face] * np.sign(local[face, np.arange(len(face))])

    def colours(self, points: np.ndarray) -> np.ndarray:
        """See `Surface.colours`."""
        return self.material(self.axes @ (points - self.origin))


def _dot(left: np.ndarray, right: np.ndarray) -> np.ndarray:
    return (left * right).sum(axis=0)
