"""Lenses: how directions in a camera's axes become places on the image plane, and back.

A pinhole shows the point (x, y, z) at (x/z, y/z): its normalised coordinates. A lens shows it elsewhere; intrinsics
turn either into pixels. Formulas are OpenCV's: see its documentation on calibration and on the fisheye camera model.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from pocketgs.errors import PocketGSError

COEFFICIENT_COUNTS = {"opencv": (0, 4, 5, 8, 12), "fisheye": (4,), "orthographic": (0,)}

# A pinhole image stretches without bound towards 90 degrees off axis: undistortion crops away what lies beyond this.
LARGEST_HALF_FIELD = math.radians(75)

# No lens of a phone or of a 360-degree camera sees further back than this.
LARGEST_FISHEYE_ANGLE = math.radians(170)

# Radians off axis by which one stride of `undistort` may change a point.
LARGEST_LEAP = 0.2

_ANGLES, _DIRECTIONS = 2048, 32
"""At how many angles off axis, and in how many directions, a lens is followed to where its polynomial turns back."""


@dataclass(frozen=True)
class Lens:
    """A lens in one of OpenCV's two models, or none at all.

    Attributes:
        model: "opencv" (k1, k2, p1, p2[, k3[, k4, k5, k6[, s1, s2, s3, s4]]]: radial, tangential and thin-prism
            distortion of normalised coordinates), "fisheye" (k1, k2, k3, k4: Kannala and Brandt's polynomial of the
            angle off axis), or "orthographic" (no coefficients: parallel rays, focal lengths in pixels per unit).
        coefficients: in OpenCV's order; empty means no distortion for "opencv".

    Raises:
        PocketGSError: the model is unknown, the number of coefficients is not its own, or one is not finite.
    """

    model: str = "opencv"
    coefficients: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        counts = COEFFICIENT_COUNTS.get(self.model)
        if counts is None:
            raise PocketGSError(f"lens: model {self.model!r}, expected one of {', '.join(COEFFICIENT_COUNTS)}")
        if len(self.coefficients) not in counts or not all(map(math.isfinite, self.coefficients)):
            raise PocketGSError(f"lens: coefficients {self.coefficients}, expected {counts} finite numbers")

    @property
    def distorts(self) -> bool:
        """Whether the lens shows anything else than a pinhole camera would."""
        return self.model != "opencv" or any(self.coefficients)

    @property
    def padded(self) -> tuple[float, ...]:
        """All twelve coefficients of an "opencv" lens: k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4."""
        return (*self.coefficients, *[0.0] * (12 - len(self.coefficients)))


PINHOLE = Lens()


def depths(lens: Lens, local: np.ndarray) -> np.ndarray:
    """(N,) what orders (N, 3) points in the camera's axes from near to far.

    It is z, the distance along the optical axis. A fisheye also shows what lies behind its image plane, where z says
    nothing of what hides what: there it is the distance from the camera.
    """
    return np.asarray(np.linalg.norm(local, axis=1) if lens.model == "fisheye" else local[:, 2])


def shown(lens: Lens, local: np.ndarray) -> np.ndarray:
    """(N,) whether a lens shows (N, 3) points in the camera's axes: they lie before it, and it has not turned back."""
    if lens.model == "orthographic":
        return np.asarray(local[:, 2] > 0)
    angles = np.arctan2(np.hypot(local[:, 0], local[:, 1]), local[:, 2])
    return np.asarray(angles < largest_angle(lens))


def project(lens: Lens, local: np.ndarray) -> np.ndarray:
    """(N, 2) where a lens shows (N, 3) points in the camera's axes: what intrinsics turn into pixels.

    What comes of points that are not `shown` means nothing.
    """
    if lens.model == "orthographic":
        return local[:, :2]
    if lens.model == "fisheye":
        radius = np.maximum(np.hypot(local[:, 0], local[:, 1]), 1e-300)
        bent = fisheye_radius(lens, np.arctan2(radius, local[:, 2]))
        return np.asarray(local[:, :2] * (bent / radius)[:, None])
    return distort(lens, local[:, :2] / local[:, 2:])


def unproject(lens: Lens, points: np.ndarray) -> np.ndarray:
    """(N, 3) directions in the camera's axes that a lens shows at (N, 2) places; times `depths` they are points.

    They have length 1 along the optical axis, or, of a fisheye, length 1. Beyond what a lens shows, the furthest
    direction that it does show is taken. An orthographic camera's rays are parallel.
    """
    if lens.model == "orthographic":
        return np.tile([0.0, 0.0, 1.0], (len(points), 1))
    if lens.model == "fisheye":
        radius = np.linalg.norm(points, axis=1)
        angle = _fisheye_angle(lens, radius)
        across = points / np.maximum(radius, 1e-300)[:, None] * np.sin(angle)[:, None]
        return np.column_stack([across, np.cos(angle)])
    seen = undistort(lens, points, largest=largest_angle(lens)) if lens.distorts else points
    return np.column_stack([seen, np.ones(len(seen))])


@lru_cache(maxsize=64)
def largest_angle(lens: Lens) -> float:
    """Radians off axis up to which a lens shows different directions in different places.

    Beyond it the polynomial turns back, or, of a fisheye, nothing can be seen.
    """
    if lens.model == "fisheye":
        angles = np.linspace(0.0, LARGEST_FISHEYE_ANGLE, _ANGLES)
        rises = np.diff(fisheye_radius(lens, angles)) > 0
        return float(angles[-1] if rises.all() else angles[np.argmin(rises)])
    if not lens.distorts:
        return math.pi / 2
    angles, points = _fan()
    with np.errstate(all="ignore"):
        jacobian, values = _jacobian(lens, points)
        # The lens has not turned back while both axes and the area keep their sense, and nothing crosses the middle.
        sound = _unfolded(jacobian) & (np.sum(values * points, axis=1) > 0)
    sound = sound.reshape(_DIRECTIONS, -1).all(axis=0)
    return math.pi / 2 if sound.all() else float(angles[max(int(np.argmin(sound)) - 1, 0)])


def _fan() -> tuple[np.ndarray, np.ndarray]:
    """(A,) angles off axis short of 90 degrees, and (D A, 2) the normalised coordinates there in all directions."""
    angles = np.linspace(0.0, math.radians(89.5), _ANGLES + 1)[1:]
    turns = np.arange(_DIRECTIONS) * (2 * math.pi / _DIRECTIONS)
    around = np.column_stack([np.cos(turns), np.sin(turns)])
    return angles, (around[:, None, :] * np.tan(angles)[None, :, None]).reshape(-1, 2)


@lru_cache(maxsize=64)
def least_radii(lens: Lens) -> tuple[np.ndarray, np.ndarray]:
    """(A,) ascending angles off axis, and (A,) how far from the middle what lies beyond each is shown at least."""
    limit = largest_angle(lens)
    if lens.model == "fisheye":
        angles = np.linspace(0.0, limit, _ANGLES)
        radii = fisheye_radius(lens, angles)
    else:
        angles, points = _fan()
        keep = angles < limit
        radii = np.linalg.norm(distort(lens, points), axis=1).reshape(_DIRECTIONS, -1).min(axis=0)[keep]
        angles, radii = np.append(0.0, angles[keep]), np.append(0.0, radii)
    return angles, np.minimum.accumulate(radii[::-1])[::-1]


def fisheye_radius(lens: Lens, angles: np.ndarray) -> np.ndarray:
    """How far from the middle a fisheye shows what lies at angles off its axis, in units of the focal length."""
    powers = angles[..., None] ** np.array([2, 4, 6, 8])
    return np.asarray(angles * (1 + powers @ np.array(lens.coefficients)))


def _fisheye_angle(lens: Lens, radii: np.ndarray) -> np.ndarray:
    """The inverse of `fisheye_radius` up to `largest_angle`, which what lies beyond is given."""
    angles = np.linspace(0.0, largest_angle(lens), _ANGLES)
    found = np.interp(radii, fisheye_radius(lens, angles), angles)
    orders = np.array([2, 4, 6, 8])
    slopes = np.array(lens.coefficients) * (orders + 1)
    for _ in range(3):
        slope = 1 + (found[:, None] ** orders) @ slopes
        found = found - (fisheye_radius(lens, found) - radii) / np.maximum(slope, 1e-6)
        found = np.clip(found, 0.0, angles[-1])
    return found


def distort(lens: Lens, points: np.ndarray) -> np.ndarray:
    """Where a lens shows points: (N, 2) normalised coordinates to (N, 2) distorted ones."""
    x, y = points[:, 0], points[:, 1]
    square = x * x + y * y
    if lens.model == "fisheye":
        radius = np.maximum(np.sqrt(square), 1e-12)
        angle = np.arctan(radius)
        powers = angle[:, None] ** np.array([2, 4, 6, 8])
        return points * (angle * (1 + powers @ np.array(lens.coefficients)) / radius)[:, None]
    k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4 = lens.padded
    radial = (1 + square * (k1 + square * (k2 + square * k3))) / (1 + square * (k4 + square * (k5 + square * k6)))
    across = x * radial + 2 * p1 * x * y + p2 * (square + 2 * x * x) + square * (s1 + square * s2)
    down = y * radial + p1 * (square + 2 * y * y) + 2 * p2 * x * y + square * (s3 + square * s4)
    return np.stack([across, down], axis=1)


def undistort(lens: Lens, points: np.ndarray, rounds: int = 48, largest: float = LARGEST_HALF_FIELD) -> np.ndarray:
    """The inverse of `distort`, for the part of the image around the optical axis where there is one.

    Each point is approached from the axis in strides, each solved by Newton's method and halved where that fails.
    This follows the inverse that belongs to the lens (a polynomial has others), and where it ends, at a fold of the
    polynomial or at the largest angle, the point stays at the last place reached. OpenCV's own iteration diverges
    there.

    Args:
        lens: the distortion.
        points: (N, 2) distorted normalised coordinates.
        rounds: most strides to try; more end closer to the fold.
        largest: radians off axis that points may reach.

    Returns:
        (N, 2) normalised coordinates.
    """
    found = np.zeros_like(points)
    reached = np.zeros((len(points), 1))
    stride = np.full((len(points), 1), 1 / 8)
    with np.errstate(all="ignore"):
        for _ in range(rounds):
            if np.all(reached == 1):
                break
            fraction = np.minimum(reached + stride, 1)
            guess, accepted = _follow(lens, found, points * fraction, largest)
            found = np.where(accepted, guess, found)
            reached = np.where(accepted, fraction, reached)
            stride = np.where(accepted, stride, stride / 2)
    return found


def _follow(lens: Lens, start: np.ndarray, target: np.ndarray, largest: float) -> tuple[np.ndarray, np.ndarray]:
    """Newton's method from `start` to where the lens shows `target`.

    Returns:
        (N, 2) normalised coordinates, and (N, 1) whether they are the solution that belongs to the lens.
    """
    guess = start
    for _ in range(4):
        jacobian, value = _jacobian(lens, guess)
        guess = guess + _solve(jacobian, target - value)
    solved = np.abs(distort(lens, guess) - target).max(axis=1) < 1e-8
    angle, start_angle = (np.arctan(np.linalg.norm(points, axis=1)) for points in (guess, start))
    # Near a fold Newton's method may leap to another branch.
    near = np.abs(angle - start_angle) < LARGEST_LEAP
    return guess, (solved & _unfolded(jacobian) & near & (angle < largest))[:, None]


def _unfolded(jacobian: np.ndarray) -> np.ndarray:
    """(N,) whether the image is not folded over: neither the derivative in x or y nor the area has changed sign."""
    return np.asarray((jacobian[:, 0, 0] > 0) & (jacobian[:, 1, 1] > 0) & (_determinant(jacobian) > 0))


def _jacobian(lens: Lens, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(N, 2, 2) derivative of `distort` by central differences, and its (N, 2) value."""
    small = 1e-6
    columns = [
        (distort(lens, points + offset) - distort(lens, points - offset)) / (2 * small)
        for offset in (np.array([small, 0.0]), np.array([0.0, small]))
    ]
    return np.stack(columns, axis=2), distort(lens, points)


def _determinant(matrices: np.ndarray) -> np.ndarray:
    return matrices[:, 0, 0] * matrices[:, 1, 1] - matrices[:, 0, 1] * matrices[:, 1, 0]


def _solve(matrices: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solve (N, 2, 2) systems by Cramer's rule, so that a singular one gives infinities and no exception."""
    across = right[:, 0] * matrices[:, 1, 1] - right[:, 1] * matrices[:, 0, 1]
    down = right[:, 1] * matrices[:, 0, 0] - right[:, 0] * matrices[:, 1, 0]
    return np.stack([across, down], axis=1) / _determinant(matrices)[:, None]
