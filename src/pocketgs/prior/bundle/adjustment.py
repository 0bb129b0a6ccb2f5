"""Bundle adjustment: optimises poses and points for the reprojection error.

The cost is half the sum of the Huber loss of each reprojection error in pixels and the squared deviations from the
given poses in units of their sigmas.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.spatial.transform import Rotation

from pocketgs.errors import PocketGSError
from pocketgs.geometry.camera import Camera
from pocketgs.prior.bundle.cpu.equations import MIN_DIAGONAL, CpuLinearizer, camera_equations
from pocketgs.prior.bundle.equations import CameraEquations, Linearizer
from pocketgs.prior.bundle.levenberg_marquardt import minimise
from pocketgs.prior.bundle.pose_prior import PosePrior, pose_prior, unheld
from pocketgs.prior.bundle.problem import by_point, check, first_estimate
from pocketgs.prior.bundle.reprojection import CAMERA_UNKNOWNS, Estimate, Sightings, distances
from pocketgs.prior.features.observations import Observations

MIRRORED_AT_ONCE = 128
"""Rows that are mirrored at once: their copy stays in the cache."""


@dataclass(frozen=True)
class BundleSettings:
    """Settings of bundle adjustment.

    Attributes:
        huber: reprojection error in pixels above which the loss is linear.
        iterations: maximum number of steps.
        position_sigma: standard deviation of the given camera centres, in scene units; None for no prior.
        rotation_sigma: standard deviation of the given rotations, in radians; None for no prior.
        tolerance: stop when a step reduces the cost by less than this share.

    Raises:
        PocketGSError: a number is not positive or not finite.
    """

    huber: float = 1.0
    iterations: int = 50
    position_sigma: float | None = None
    rotation_sigma: float | None = None
    tolerance: float = 1e-8

    def __post_init__(self) -> None:
        for name in ("huber", "iterations", "position_sigma", "rotation_sigma", "tolerance"):
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and value > 0):
                raise PocketGSError(f"bundle settings: {name} = {value}, expected a positive number")

    @property
    def holds_poses(self) -> bool:
        """Whether there is a prior on every pose, so that poses need no minimum number of points."""
        return self.position_sigma is not None and self.rotation_sigma is not None


@dataclass(frozen=True, eq=False)
class BundleResult:
    """The result of bundle adjustment.

    Attributes:
        cameras: the given cameras with optimised poses.
        points: (N, 3) float64.
        residuals: (M,) float64 reprojection errors after optimisation, in pixels, in the order of the observations. A
            point behind its camera counts as `reprojection.BEHIND`.
        rmse_before, rmse_after: root mean square reprojection error of all observations, in pixels.
        iterations: number of steps tried.
        converged: whether it stopped before the maximum number of steps.
        cost_before, cost_after: the minimised cost.
    """

    cameras: list[Camera]
    points: np.ndarray
    residuals: np.ndarray
    rmse_before: float
    rmse_after: float
    iterations: int
    converged: bool
    cost_before: float
    cost_after: float


@dataclass(frozen=True, eq=False)
class PoseResult:
    """The result of motion-only adjustment; attributes as in `BundleResult`."""

    camera: Camera
    residuals: np.ndarray
    rmse_before: float
    rmse_after: float
    iterations: int
    converged: bool
    cost_before: float
    cost_after: float


def adjust_bundle(
    cameras: Sequence[Camera],
    points: np.ndarray,
    observations: Observations,
    settings: BundleSettings,
    start: Sequence[Camera] | None = None,
    linearizer: Linearizer | None = None,
) -> BundleResult:
    """Optimise poses and points.

    Without `position_sigma`, the gauge is fixed by the first camera's centre and one coordinate of the camera farthest
    from it; without both sigmas, also by the first camera's rotation.

    Args:
        cameras: F cameras from the sensor or a file: the centre of the prior, and the start unless `start` is given.
        points: (N, 3) start.
        observations: where points were observed.
        settings: see `BundleSettings`.
        start: initial poses, of F cameras.
        linearizer: makes the normal equations; None for the CPU.

    Raises:
        PocketGSError: array shapes disagree or numbers are not finite, a point is observed by fewer than two cameras, a
            camera without a pose prior observes fewer than three points, or all cameras are in one place without a
            prior on positions.
    """
    check(cameras, points, observations, fewest_views=2, poses_known=settings.holds_poses)
    order = np.argsort(observations.point, kind="stable")
    sightings = by_point(cameras, len(points), observations, order)
    first = first_estimate(start or cameras, points)
    given = first_estimate(cameras, points)
    prior = pose_prior(given, settings.position_sigma, settings.rotation_sigma)
    free = unheld(first, settings.position_sigma is not None, settings.rotation_sigma is not None)
    equations = (linearizer or CpuLinearizer()).equations(sightings, settings.huber)

    def step(estimate: Estimate, damping: float) -> tuple[Estimate, float]:
        reduced = equations.reduced(estimate, damping)
        camera_step, expected = _solve(reduced, prior, estimate, damping, free)
        moves, expected_of_points = equations.point_steps(camera_step)
        moved = _moved(estimate, camera_step)._replace(points=estimate.points + moves)
        return moved, expected + expected_of_points

    cost = partial(_cost, sightings, prior, settings.huber)
    outcome = minimise(first, cost, step, settings.iterations, settings.tolerance)
    residuals = np.empty(len(order))
    residuals[order] = distances(sightings, outcome.state)
    return BundleResult(
        cameras=_posed(cameras, outcome.state),
        points=outcome.state.points,
        residuals=residuals,
        rmse_before=_root_mean_square(distances(sightings, first)),
        rmse_after=_root_mean_square(residuals),
        iterations=outcome.iterations,
        converged=outcome.converged,
        cost_before=outcome.cost_before,
        cost_after=outcome.cost,
    )


def adjust_pose(camera: Camera, points: np.ndarray, pixels: np.ndarray, settings: BundleSettings) -> PoseResult:
    """Optimise one pose with fixed points.

    Args:
        camera: start, and centre of the prior.
        points: (M, 3).
        pixels: (M, 2) observations.
        settings: see `BundleSettings`.

    Raises:
        PocketGSError: array shapes disagree or numbers are not finite, or there are fewer than three points and no pose
            prior.
    """
    if len(points) != len(pixels):
        raise PocketGSError(f"bundle: {len(points)} points and {len(pixels)} pixels, expected the same number")
    each = np.arange(len(pixels))
    observations = Observations(np.zeros_like(each), each, pixels)
    check([camera], points, observations, fewest_views=1, poses_known=settings.holds_poses)
    sightings = by_point([camera], len(points), observations, each)
    start = first_estimate([camera], points)
    prior = pose_prior(start, settings.position_sigma, settings.rotation_sigma)
    free = np.ones(CAMERA_UNKNOWNS, bool)

    def step(estimate: Estimate, damping: float) -> tuple[Estimate, float]:
        equations = camera_equations(sightings, estimate, settings.huber)
        camera_step, expected = _solve(equations, prior, estimate, damping, free)
        return _moved(estimate, camera_step), expected

    cost = partial(_cost, sightings, prior, settings.huber)
    outcome = minimise(start, cost, step, settings.iterations, settings.tolerance)
    residuals = distances(sightings, outcome.state)
    return PoseResult(
        camera=_posed([camera], outcome.state)[0],
        residuals=residuals,
        rmse_before=_root_mean_square(distances(sightings, start)),
        rmse_after=_root_mean_square(residuals),
        iterations=outcome.iterations,
        converged=outcome.converged,
        cost_before=outcome.cost_before,
        cost_after=outcome.cost,
    )


def huber_cost(lengths: np.ndarray, huber: float) -> float:
    """½ Σ ρ: r² up to `huber`, and 2 huber r - huber² beyond (Huber 1964)."""
    inner = np.minimum(lengths, huber)
    return float(np.sum(inner * (lengths - 0.5 * inner)))


def _cost(sightings: Sightings, prior: PosePrior, huber: float, estimate: Estimate) -> float:
    """The cost that is minimised."""
    return huber_cost(distances(sightings, estimate), huber) + prior.cost(estimate)


def _root_mean_square(lengths: np.ndarray) -> float:
    return float(np.sqrt(np.mean(lengths**2)))


def _solve(
    equations: CameraEquations, prior: PosePrior, estimate: Estimate, damping: float, free: np.ndarray
) -> tuple[np.ndarray, float]:
    """(D,) step of the cameras, 0 for fixed unknowns, and the cameras' part of the expected decrease.

    The expected decrease of the linear model is ½ hᵀ (μ D h + b): Madsen, Nielsen and Tingleff (2004), equation 3.14.
    """
    slope = -prior.weights * prior.deviation(estimate)
    added = damping * np.maximum(equations.diagonal + prior.weights, MIN_DIAGONAL)
    # With many cameras, the matrix is the largest array of all: nothing else needs it, and it is not copied.
    matrix = equations.matrix
    matrix[np.diag_indices_from(matrix)] += prior.weights + added
    matrix = _symmetric(matrix if free.all() else matrix[np.ix_(free, free)])
    factor = cho_factor(matrix.T, lower=True, overwrite_a=True, check_finite=False)
    step = np.zeros(len(free))
    step[free] = cho_solve(factor, (equations.right + slope)[free], check_finite=False)
    return step, 0.5 * float(step @ (added * step + equations.gradient + slope))


def _symmetric(matrix: np.ndarray) -> np.ndarray:
    """The matrix, with its lower triangle mirrored to the upper one: its transpose is then in LAPACK's order."""
    for start in range(0, len(matrix), MIRRORED_AT_ONCE):
        end = start + MIRRORED_AT_ONCE
        matrix[start:end, end:] = matrix[end:, start:end].T
        lower = np.tril(matrix[start:end, start:end])
        matrix[start:end, start:end] = lower + np.tril(lower, -1).T
    return matrix


def _moved(estimate: Estimate, camera_step: np.ndarray) -> Estimate:
    """The estimate after a step of the cameras."""
    by_camera = camera_step.reshape(-1, CAMERA_UNKNOWNS)
    return estimate._replace(
        rotations=Rotation.from_rotvec(by_camera[:, :3]).as_matrix() @ estimate.rotations,
        centres=estimate.centres + by_camera[:, 3:],
    )


def _posed(cameras: Sequence[Camera], estimate: Estimate) -> list[Camera]:
    """The cameras with the poses of the estimate."""
    posed = []
    for camera, rotation, centre in zip(cameras, estimate.rotations, estimate.centres, strict=True):
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = rotation, -rotation @ centre
        posed.append(replace(camera, world_to_camera=pose))
    return posed
