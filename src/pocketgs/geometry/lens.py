"""Lens models: projection of directions in camera axes to the image plane, and its inverse.

A pinhole camera projects the point (x, y, z) to (x/z, y/z), its normalised coordinates. A lens distorts these;
intrinsics convert either to pixels. Formulas are OpenCV's: see its documentation on calibration and on the fisheye
camera model.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from pocketgs.errors import PocketGSError

COEFFICIENT_COUNTS = {"opencv": (0, 4, 5, 8, 12), "fisheye": (4,), "orthographic": (0,)}

# A pinhole image stretches without bound towards 90 degrees off axis: undistortion crops it at this angle.
MAX_HALF_FIELD = math.radians(75)

# No lens of a phone or of a 360-degree camera has a larger angle off axis.
MAX_FISHEYE_ANGLE = math.radians(170)

# Maximum step of a point in `undistort`, in radians off axis.
MAX_STEP = 0.2

KEPT_LENSES = 2048
"""Lenses whose bounds are kept, at 32 KB each: every view of a capture may have one of its own, and bounds take longer
than a step."""

_ANGLES, _DIRECTIONS = 2048, 32
"""Number of angles off axis, and of directions, at which a lens is sampled to find where its polynomial folds."""


@dataclass(frozen=True)
class Lens:
    """A lens model with its coefficients.

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
        """Whether the projection differs from a pinhole camera's."""
        return self.model != "opencv" or any(self.coefficients)

    @property
    def padded(self) -> tuple[float, ...]:
        """All twelve coefficients of an "opencv" lens: k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4."""
        return (*self.coefficients, *[0.0] * (12 - len(self.coefficients)))


PINHOLE = Lens()


def depths(lens: Lens, local: np.ndarray) -> np.ndarray:
    """(N,) depths that order (N, 3) points in camera axes from near to far.

    It is z, the distance along the optical axis. A fisheye also shows points behind its image plane, where z does not
    order occlusions: there it is the distance from the camera.
    """
    return np.asarray(np.linalg.norm(local, axis=1) if lens.model == "fisheye" else local[:, 2])


def shown(lens: Lens, local: np.ndarray) -> np.ndarray:
    """(N,) whether a lens shows (N, 3) points in camera axes: in front of it, and within its valid angle."""
    if lens.model == "orthographic":
        return np.asarray(local[:, 2] > 0)
    angles = np.arctan2(np.hypot(local[:, 0], local[:, 1]), local[:, 2])
    return np.asarray(angles < largest_angle(lens))


def project(lens: Lens, local: np.ndarray) -> np.ndarray:
    """(N, 2) distorted normalised coordinates of (N, 3) points in camera axes; intrinsics convert them to pixels.

    Results for points that are not `shown` are undefined.
    """
    if lens.model == "orthographic":
        return local[:, :2]
    if lens.model == "fisheye":
        radius = np.maximum(np.hypot(local[:, 0], local[:, 1]), 1e-300)
        bent = fisheye_radius(lens, np.arctan2(radius, local[:, 2]))
        return np.asarray(local[:, :2] * (bent / radius)[:, None])
    return distort(lens, local[:, :2] / local[:, 2:])


def unproject(lens: Lens, points: np.ndarray) -> np.ndarray:
    """(N, 3) directions in camera axes of (N, 2) distorted normalised coordinates; times `depths` they are points.

    They have length 1 along the optical axis, or for a fisheye length 1. Outside the valid image, the furthest valid
    direction is returned. An orthographic camera's rays are parallel.
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


@lru_cache(maxsize=KEPT_LENSES)
def largest_angle(lens: Lens) -> float:
    """Maximum angle off axis, in radians, up to which a lens is one-to-one.

    Beyond it the polynomial folds back, or for a fisheye nothing is visible.

    Raises:
        PocketGSError: it folds back at the optical axis, so that it has no image.
    """
    angle = _fold(lens)
    if angle == 0.0:
        raise PocketGSError(f"lens: coefficients {lens.coefficients} fold the image back at its middle")
    return angle


def _fold(lens: Lens) -> float:
    """(radians) `largest_angle`, or 0 if there is none."""
    if lens.model == "fisheye":
        angles = np.linspace(0.0, MAX_FISHEYE_ANGLE, _ANGLES)
        rises = np.diff(fisheye_radius(lens, angles)) > 0
        return float(angles[-1] if rises.all() else angles[np.argmin(rises)])
    if not lens.distorts:
        return math.pi / 2
    angles, points = _fan()
    with np.errstate(all="ignore"):
        jacobian, values = _jacobian(lens, points)
        # The lens is one-to-one as long as both axes and the area keep their orientation, and nothing crosses the
        # middle.
        sound = _unfolded(jacobian) & (np.sum(values * points, axis=1) > 0)
    sound = sound.reshape(_DIRECTIONS, -1).all(axis=0)
    if sound.all():
        return math.pi / 2
    last = int(np.argmin(sound)) - 1
    return float(angles[last]) if last > 0 else 0.0


def _fan() -> tuple[np.ndarray, np.ndarray]:
    """(A,) angles off axis below 90 degrees, and (D A, 2) their normalised coordinates in all directions."""
    angles = np.linspace(0.0, math.radians(89.5), _ANGLES + 1)[1:]
    turns = np.arange(_DIRECTIONS) * (2 * math.pi / _DIRECTIONS)
    around = np.column_stack([np.cos(turns), np.sin(turns)])
    return angles, (around[:, None, :] * np.tan(angles)[None, :, None]).reshape(-1, 2)


@lru_cache(maxsize=KEPT_LENSES)
def least_radii(lens: Lens) -> tuple[np.ndarray, np.ndarray]:
    """(A,) ascending angles off axis, and (A,) the minimum distorted radius of points beyond each."""
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
    """Distance from the middle, in focal lengths, at which a fisheye shows points at some angles off its axis."""
    powers = angles[..., None] ** np.array([2, 4, 6, 8])
    return np.asarray(angles * (1 + powers @ np.array(lens.coefficients)))


def _fisheye_angle(lens: Lens, radii: np.ndarray) -> np.ndarray:
    """The inverse of `fisheye_radius` up to `largest_angle`; larger radii get that angle."""
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
    """Distort (N, 2) normalised coordinates."""
    x, y = points[:, 0], points[:, 1]
    square = x * x + y * y
    if lens.model == "fisheye":
        radius = np.maximum(np.sqrt(square), 1e-12)
        return points * (fisheye_radius(lens, np.arctan(radius)) / radius)[:, None]
    k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4 = lens.padded
    radial = (1 + square * (k1 + square * (k2 + square * k3))) / (1 + square * (k4 + square * (k5 + square * k6)))
    across = x * radial + 2 * p1 * x * y + p2 * (square + 2 * x * x) + square * (s1 + square * s2)
    down = y * radial + p1 * (square + 2 * y * y) + 2 * p2 * x * y + square * (s3 + square * s4)
    return np.stack([across, down], axis=1)


def undistort(lens: Lens, points: np.ndarray, rounds: int = 48, largest: float = MAX_HALF_FIELD) -> np.ndarray:
    """The inverse of `distort`, for the part of the image around the optical axis where it exists.

    Each point is approached from the axis in steps, each solved by Newton's method and halved if that fails. This
    follows the branch of the inverse that belongs to the lens (a polynomial has others). Where it ends, at a fold of
    the polynomial or at the maximum angle, the point stays at the last position reached. OpenCV's own iteration
    diverges there.

    Args:
        lens: the distortion.
        points: (N, 2) distorted normalised coordinates.
        rounds: maximum number of steps; more end closer to the fold.
        largest: maximum angle off axis in radians.

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
    """Newton's method from `start` to the coordinates that the lens maps to `target`.

    Returns:
        (N, 2) normalised coordinates, and (N, 1) whether they converged to the right branch.
    """
    guess = start
    for _ in range(4):
        jacobian, value = _jacobian(lens, guess)
        guess = guess + _solve(jacobian, target - value)
    solved = np.abs(distort(lens, guess) - target).max(axis=1) < 1e-8
    angle, start_angle = (np.arctan(np.linalg.norm(points, axis=1)) for points in (guess, start))
    # Near a fold Newton's method may jump to another branch.
    near = np.abs(angle - start_angle) < MAX_STEP
    return guess, (solved & _unfolded(jacobian) & near & (angle < largest))[:, None]


def _unfolded(jacobian: np.ndarray) -> np.ndarray:
    """(N,) whether the image is not folded: neither the derivatives in x and y nor the area has changed sign."""
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
    """Solve (N, 2, 2) systems by Cramer's rule, which gives infinities for singular ones instead of an exception."""
    across = right[:, 0] * matrices[:, 1, 1] - right[:, 1] * matrices[:, 0, 1]
    down = right[:, 1] * matrices[:, 0, 0] - right[:, 0] * matrices[:, 1, 0]
    return np.stack([across, down], axis=1) / _determinant(matrices)[:, None]
