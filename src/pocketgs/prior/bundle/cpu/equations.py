"""Normal equations on the CPU, in double precision; see `equations.py` for the method."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import prange

from pocketgs.prior.bundle.equations import CameraEquations
from pocketgs.prior.bundle.reprojection import CAMERA_UNKNOWNS, COLUMNS, Estimate, Sightings, linearise, weigh
from pocketgs.system.compile import kernel, parallel_kernel, part
from pocketgs.system.device import DeviceName

MAX_SHARES = 16
"""Maximum number of parts that the points are split into, which are summed in parallel."""

SHARE_BYTES = 256_000_000
"""Bytes that the matrices of all parts may take together, unless one alone takes more.

Each part has a dense matrix of its own, which grows with the square of the number of cameras: with 1,000 cameras, 16 of
them would take 4.6 GB.
"""

MIN_DIAGONAL = 1e-9
"""Damping is proportional to the diagonal of JᵀJ, with this lower bound."""


class PointEquations(NamedTuple):
    """The points' side.

    Attributes:
        inverses: (N, 3, 3) H_pp⁻¹, damped.
        gradients: (N, 3) b_p.
        damping: (N, 3) damping added to the diagonals of H_pp.
    """

    inverses: np.ndarray
    gradients: np.ndarray
    damping: np.ndarray


class CpuEquations:
    """See `pocketgs.prior.bundle.equations.NormalEquations`.

    Args:
        sightings: the observations.
        huber: length in pixels above which the loss of a residual is linear.
    """

    _estimate: Estimate
    _points: PointEquations

    def __init__(self, sightings: Sightings, huber: float) -> None:
        self._sightings, self._huber = sightings, huber

    def reduced(self, estimate: Estimate, damping: float) -> CameraEquations:
        """The equations for the cameras' step."""
        self._estimate = estimate
        equations, self._points = reduced_equations(self._sightings, estimate, self._huber, damping)
        return equations

    def point_steps(self, camera_step: np.ndarray) -> tuple[np.ndarray, float]:
        """Steps of the points, and their part of the expected decrease."""
        steps = point_steps(self._sightings, self._estimate, self._huber, self._points, camera_step)
        return steps, 0.5 * float(np.sum(steps * (self._points.damping * steps + self._points.gradients)))


class CpuLinearizer:
    """See `pocketgs.prior.bundle.equations.Linearizer`."""

    name: DeviceName = "cpu"

    def equations(self, sightings: Sightings, huber: float) -> CpuEquations:
        """The equations of a problem."""
        return CpuEquations(sightings, huber)

    def release(self) -> None:
        """Nothing is held."""


@kernel
def camera_equations(sightings: Sightings, estimate: Estimate, huber: float) -> CameraEquations:
    """The equations for the cameras' steps with fixed points.

    Args:
        sightings: the observations.
        estimate: where to linearise.
        huber: length in pixels above which the loss of a residual is linear.
    """
    size = CAMERA_UNKNOWNS * len(estimate.centres)
    gradient = np.zeros(size)
    equations = CameraEquations(np.zeros((size, size)), gradient, np.zeros(size), gradient)
    residual, jacobian = np.empty(2), np.empty((2, COLUMNS))
    for k in range(len(sightings.frame)):
        if linearise(sightings, estimate, k, residual, jacobian):
            weigh(residual, jacobian, huber)
            _add_to_cameras(sightings.frame[k], residual, jacobian, equations)
    return equations


def reduced_equations(
    sightings: Sightings, estimate: Estimate, huber: float, damping: float
) -> tuple[CameraEquations, PointEquations]:
    """The equations for the cameras' steps with the points eliminated.

    Args:
        sightings: the observations.
        estimate: where to linearise.
        huber: length in pixels above which the loss of a residual is linear.
        damping: the diagonals of H_pp grow by this factor of themselves.
    """
    count = len(estimate.points)
    size = CAMERA_UNKNOWNS * len(estimate.centres)
    points = PointEquations(np.empty((count, 3, 3)), np.empty((count, 3)), np.empty((count, 3)))
    parts = share_count(len(estimate.centres))
    shares = CameraEquations(np.zeros((parts, size, size)), *np.zeros((3, parts, size)))
    _reduce(sightings, estimate, huber, damping, points, shares)
    # A single part is not copied: its matrix is large.
    return CameraEquations(*(share[0] if parts == 1 else share.sum(axis=0) for share in shares)), points


def share_count(cameras: int) -> int:
    """Number of parts that the points are split into.

    It depends on nothing but the number of cameras, so sums do not depend on the number of threads.
    """
    matrix_bytes = np.dtype(np.float64).itemsize * (CAMERA_UNKNOWNS * cameras) ** 2
    return min(max(SHARE_BYTES // max(matrix_bytes, 1), 1), MAX_SHARES)


@kernel
def point_steps(
    sightings: Sightings, estimate: Estimate, huber: float, points: PointEquations, camera_step: np.ndarray
) -> np.ndarray:
    """(N, 3) steps of the points for a step of the cameras: back-substitution.

    Args:
        sightings: the observations.
        estimate: where the equations were linearised.
        huber: as for `reduced_equations`.
        points: from `reduced_equations`.
        camera_step: (D,).
    """
    steps = np.empty_like(estimate.points)
    residual, jacobian = np.empty(2), np.empty((2, COLUMNS))
    for p in range(len(steps)):
        right = points.gradients[p].copy()
        for k in range(sightings.starts[p], sightings.starts[p + 1]):
            if linearise(sightings, estimate, k, residual, jacobian):
                weigh(residual, jacobian, huber)
                camera = CAMERA_UNKNOWNS * sightings.frame[k]
                for row in range(2):
                    moved = 0.0
                    for a in range(CAMERA_UNKNOWNS):
                        moved += jacobian[row, a] * camera_step[camera + a]
                    for axis in range(3):
                        right[axis] -= jacobian[row, CAMERA_UNKNOWNS + axis] * moved
        for axis in range(3):
            row_of_inverse = points.inverses[p, axis]
            steps[p, axis] = row_of_inverse[0] * right[0] + row_of_inverse[1] * right[1] + row_of_inverse[2] * right[2]
    return steps


@parallel_kernel
def _reduce(
    sightings: Sightings,
    estimate: Estimate,
    huber: float,
    damping: float,
    points: PointEquations,
    shares: CameraEquations,
) -> None:
    """Write `points`, and add to `shares`, whose arrays have an additional axis with one slot per share."""
    count = len(shares.right)
    for share in prange(count):
        first, end = share * len(estimate.points) // count, (share + 1) * len(estimate.points) // count
        own = CameraEquations(shares.matrix[share], shares.right[share], shares.diagonal[share], shares.gradient[share])
        _reduce_share(sightings, estimate, huber, damping, first, end, points, own)


@part
def _reduce_share(
    sightings: Sightings,
    estimate: Estimate,
    huber: float,
    damping: float,
    first_point: int,
    end_point: int,
    points: PointEquations,
    cameras: CameraEquations,
) -> None:
    """Add points from `first_point` to before `end_point` to `cameras`, and write their rows of `points`."""
    starts = sightings.starts
    most = np.max(starts[1:] - starts[:-1])
    residual, jacobian = np.empty(2), np.empty((2, COLUMNS))
    coupling, matrix = np.empty((most, CAMERA_UNKNOWNS, 3)), np.empty((3, 3))
    for p in range(first_point, end_point):
        first, last, gradient = starts[p], starts[p + 1], points.gradients[p]
        coupling[: last - first] = 0.0
        matrix[:] = 0.0
        gradient[:] = 0.0
        for k in range(first, last):
            if linearise(sightings, estimate, k, residual, jacobian):
                weigh(residual, jacobian, huber)
                _add_to_cameras(sightings.frame[k], residual, jacobian, cameras)
                _add_to_point(residual, jacobian, matrix, gradient)
                _add_to_coupling(jacobian, coupling[k - first])
        for axis in range(3):
            points.damping[p, axis] = damping * max(matrix[axis, axis], MIN_DIAGONAL)
            matrix[axis, axis] += points.damping[p, axis]
        _invert(matrix, points.inverses[p])
        _eliminate(sightings.frame[first:last], coupling, points.inverses[p], gradient, cameras)
    for row in range(len(cameras.right)):
        cameras.right[row] += cameras.gradient[row]


@part
def _add_to_cameras(frame: int, residual: np.ndarray, jacobian: np.ndarray, cameras: CameraEquations) -> None:
    """Add an observation to the lower triangle of H_cc, to its diagonal, and to b_c."""
    matrix, diagonal, gradient = cameras.matrix, cameras.diagonal, cameras.gradient
    first = CAMERA_UNKNOWNS * frame
    for a in range(CAMERA_UNKNOWNS):
        gradient[first + a] -= jacobian[0, a] * residual[0] + jacobian[1, a] * residual[1]
        diagonal[first + a] += jacobian[0, a] ** 2 + jacobian[1, a] ** 2
        for b in range(a + 1):
            matrix[first + a, first + b] += jacobian[0, a] * jacobian[0, b] + jacobian[1, a] * jacobian[1, b]


@part
def _add_to_point(residual: np.ndarray, jacobian: np.ndarray, matrix: np.ndarray, gradient: np.ndarray) -> None:
    """Add an observation to H_pp and to b_p."""
    for a in range(3):
        left, right = jacobian[0, CAMERA_UNKNOWNS + a], jacobian[1, CAMERA_UNKNOWNS + a]
        gradient[a] -= left * residual[0] + right * residual[1]
        for b in range(3):
            matrix[a, b] += left * jacobian[0, CAMERA_UNKNOWNS + b] + right * jacobian[1, CAMERA_UNKNOWNS + b]


@part
def _add_to_coupling(jacobian: np.ndarray, coupling: np.ndarray) -> None:
    """Add an observation to its camera's rows of H_cp."""
    for axis in range(3):
        down, across = jacobian[0, CAMERA_UNKNOWNS + axis], jacobian[1, CAMERA_UNKNOWNS + axis]
        for a in range(CAMERA_UNKNOWNS):
            coupling[a, axis] += jacobian[0, a] * down + jacobian[1, a] * across


@part
def _invert(matrix: np.ndarray, inverse: np.ndarray) -> None:
    """Write the inverse of a positive definite 3x3 matrix by its Cholesky factor L: (L⁻¹)ᵀ L⁻¹.

    Cofactors would lose all digits for a point that is seen with little parallax.
    """
    a = 1.0 / math.sqrt(matrix[0, 0])
    l10, l20 = matrix[1, 0] * a, matrix[2, 0] * a
    b = 1.0 / math.sqrt(matrix[1, 1] - l10 * l10)
    l21 = (matrix[2, 1] - l20 * l10) * b
    c = 1.0 / math.sqrt(matrix[2, 2] - l20 * l20 - l21 * l21)
    i10, i21 = -l10 * a * b, -l21 * b * c
    i20 = -(l20 * a + l21 * i10) * c
    inverse[0, 0], inverse[1, 1], inverse[2, 2] = a * a + i10 * i10 + i20 * i20, b * b + i21 * i21, c * c
    inverse[0, 1] = inverse[1, 0] = i10 * b + i20 * i21
    inverse[0, 2] = inverse[2, 0] = i20 * c
    inverse[1, 2] = inverse[2, 1] = i21 * c


@part
def _eliminate(
    frames: np.ndarray, coupling: np.ndarray, inverse: np.ndarray, gradient: np.ndarray, cameras: CameraEquations
) -> None:
    """Subtract H_cp H_pp⁻¹ H_pc and H_cp H_pp⁻¹ b_p of one point."""
    count, matrix, right = len(frames), cameras.matrix, cameras.right
    for i in range(count):
        row = CAMERA_UNKNOWNS * frames[i]
        for a in range(CAMERA_UNKNOWNS):
            x, y, z = coupling[i, a, 0], coupling[i, a, 1], coupling[i, a, 2]
            u = x * inverse[0, 0] + y * inverse[1, 0] + z * inverse[2, 0]
            v = x * inverse[0, 1] + y * inverse[1, 1] + z * inverse[2, 1]
            w = x * inverse[0, 2] + y * inverse[1, 2] + z * inverse[2, 2]
            right[row + a] -= u * gradient[0] + v * gradient[1] + w * gradient[2]
            for j in range(count):
                column = CAMERA_UNKNOWNS * frames[j]
                if column <= row:
                    for b in range(CAMERA_UNKNOWNS):
                        other = coupling[j, b]
                        matrix[row + a, column + b] -= u * other[0] + v * other[1] + w * other[2]
