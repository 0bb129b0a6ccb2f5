"""Derivatives of reprojection errors, and the elimination of points."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pocketgs.prior.bundle.cpu.equations import (
    MAX_SHARES,
    MIN_DIAGONAL,
    SHARE_BYTES,
    point_steps,
    reduced_equations,
    share_count,
)
from pocketgs.prior.bundle.problem import by_point, first_estimate
from pocketgs.prior.bundle.reprojection import COLUMNS, Estimate, linearise, weigh
from prior.bundle_problem import make_problem


def shifted(estimate: Estimate, frame: int, point: int, step: np.ndarray) -> Estimate:
    """The estimate with one camera and one point changed by (COLUMNS,)."""
    rotations, moved, points = estimate.rotations.copy(), estimate.centres.copy(), estimate.points.copy()
    rotations[frame] = Rotation.from_rotvec(step[:3]).as_matrix() @ rotations[frame]
    moved[frame] += step[3:6]
    points[point] += step[6:]
    return Estimate(rotations, moved, points)


def test_jacobian_is_that_of_finite_differences() -> None:
    problem = make_problem(noise=3.0)
    observations = problem.observations
    sightings = by_point(problem.cameras, len(problem.points), observations, np.argsort(observations.point))
    estimate = first_estimate(problem.cameras, problem.points)
    residual, jacobian = np.empty(2), np.empty((2, COLUMNS))
    above, below, ignored = np.empty(2), np.empty(2), np.empty((2, COLUMNS))
    step = 1e-6
    for k in range(0, len(sightings.frame), 17):
        assert linearise(sightings, estimate, k, residual, jacobian)
        for column in range(COLUMNS):
            change = step * np.eye(COLUMNS)[column]
            at = sightings.frame[k], sightings.point[k]
            linearise(sightings, shifted(estimate, *at, change), k, above, ignored)
            linearise(sightings, shifted(estimate, *at, -change), k, below, ignored)
            np.testing.assert_allclose(jacobian[:, column], (above - below) / (2 * step), rtol=1e-6, atol=1e-5)


@pytest.mark.parametrize("repeated", [False, True], ids=["once", "twice in one frame"])
def test_reduced_equations_give_the_step_of_the_whole_system(repeated: bool) -> None:
    problem = make_problem(frames=4, points=20, views=3, noise=1.0)
    observations, huber, damping = problem.observations, 3.0, 1e-3
    if repeated:
        observations = observations.select(np.append(np.arange(len(observations.frame)), [0, 0, 5]))
    sightings = by_point(problem.cameras, 20, observations, np.argsort(observations.point, kind="stable"))
    estimate = first_estimate(problem.cameras, problem.points)
    size, count = 6 * 4, len(sightings.frame)
    dense, right = np.zeros((2 * count, size + 60)), np.zeros(2 * count)
    for k in range(count):
        residual, jacobian = np.empty(2), np.empty((2, COLUMNS))
        assert linearise(sightings, estimate, k, residual, jacobian)
        weigh(residual, jacobian, huber)
        rows, first, point = slice(2 * k, 2 * k + 2), 6 * sightings.frame[k], size + 3 * sightings.point[k]
        dense[rows, first : first + 6] = jacobian[:, :6]
        dense[rows, point : point + 3] = jacobian[:, 6:]
        right[rows] = -residual
    normal = dense.T @ dense
    normal += damping * np.diag(np.maximum(np.diag(normal), MIN_DIAGONAL))
    expected = np.linalg.solve(normal, dense.T @ right)

    equations, points = reduced_equations(sightings, estimate, huber, damping)
    np.testing.assert_allclose(equations.diagonal, np.diag(dense.T @ dense)[:size], rtol=1e-10)
    matrix = np.tril(equations.matrix) + np.tril(equations.matrix, -1).T + damping * np.diag(equations.diagonal)
    camera_step = np.linalg.solve(matrix, equations.right)
    np.testing.assert_allclose(camera_step, expected[:size], rtol=1e-6, atol=1e-9)
    moves = point_steps(sightings, estimate, huber, points, camera_step)
    np.testing.assert_allclose(moves.ravel(), expected[size:], rtol=1e-6, atol=1e-9)


def test_memory_of_many_cameras_is_bounded() -> None:
    """Every part of the points has a matrix of its own: with 400 cameras, 16 of them would take 740 MB."""
    problem = make_problem(frames=400, points=40, views=3)
    observations = problem.observations
    sightings = by_point(problem.cameras, 40, observations, np.argsort(observations.point))
    matrix_bytes = 8 * (6 * 400) ** 2
    tracemalloc.start()
    try:
        reduced_equations(sightings, first_estimate(problem.cameras, problem.points), 3.0, 1e-3)
        assert tracemalloc.get_traced_memory()[1] < SHARE_BYTES + 2 * matrix_bytes
    finally:
        tracemalloc.stop()


def test_few_cameras_use_all_parts_and_many_at_least_one() -> None:
    assert [share_count(cameras) for cameras in (1, 235, 236, 1000, 5000)] == [MAX_SHARES, MAX_SHARES, 15, 1, 1]
