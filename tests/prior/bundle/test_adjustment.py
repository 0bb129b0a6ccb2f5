"""Bundle adjustment: solutions against other solvers and against the truth, priors, gauges."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace

import numba
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares

from pocketgs.geometry.camera import Camera
from pocketgs.prior.bundle.adjustment import (
    BundleResult,
    BundleSettings,
    _solve,
    adjust_bundle,
    adjust_pose,
    huber_cost,
)
from pocketgs.prior.bundle.equations import CameraEquations
from pocketgs.prior.bundle.pose_prior import pose_prior
from pocketgs.prior.bundle.problem import first_estimate
from pocketgs.prior.bundle.reprojection import BEHIND
from prior.bundle_problem import Problem, centres, make_problem, pose_errors, predicted, turned_and_moved

FREE = BundleSettings()
HELD = BundleSettings(position_sigma=0.02, rotation_sigma=0.02)


def solve(problem: Problem, settings: BundleSettings = FREE) -> BundleResult:
    return adjust_bundle(problem.cameras, problem.points, problem.observations, settings)


def solve_with_scipy(problem: Problem, settings: BundleSettings) -> tuple[float, list[Camera], np.ndarray]:
    """Final cost, cameras and points of the same objective in SciPy's hands, with finite differences."""
    frames = len(problem.cameras)

    def unpack(unknowns: np.ndarray) -> tuple[list[Camera], np.ndarray]:
        poses, moves = unknowns[: 6 * frames].reshape(-1, 6), unknowns[6 * frames :].reshape(-1, 3)
        cameras = [turned_and_moved(camera, p[:3], p[3:]) for camera, p in zip(problem.cameras, poses, strict=True)]
        return cameras, problem.points + moves

    def residuals(unknowns: np.ndarray) -> np.ndarray:
        error = predicted(*unpack(unknowns), problem.observations) - problem.observations.pixels
        length = np.linalg.norm(error, axis=1)
        # Half the square of this is the Huber cost of the length of each error, which SciPy's own loss, a component at
        # a time, is not.
        robust = np.sqrt(np.where(length < settings.huber, length**2, settings.huber * (2 * length - settings.huber)))
        prior = unknowns[: 6 * frames].reshape(-1, 6)
        turn, offset = (
            prior[:, :3] / (settings.rotation_sigma or np.inf),
            prior[:, 3:] / (settings.position_sigma or np.inf),
        )
        return np.concatenate([(error * (robust / length)[:, None]).ravel(), turn.ravel(), offset.ravel()])

    start = np.zeros(6 * frames + problem.points.size)
    found = least_squares(residuals, start, x_scale="jac", ftol=1e-12, xtol=1e-12, gtol=1e-10, max_nfev=60)
    return found.cost, *unpack(found.x)


@pytest.mark.parametrize(
    "settings",
    [
        FREE,
        HELD,
        BundleSettings(rotation_sigma=0.01),
        BundleSettings(position_sigma=0.01),
    ],
    ids=["free", "held", "rotations held", "positions held"],
)
def test_agrees_with_scipy(settings: BundleSettings) -> None:
    problem = make_problem(frames=3, points=8, views=3, noise=1.0, pose_error=0.01, point_error=0.02)
    result = solve(problem, replace(settings, tolerance=1e-13, iterations=200))
    cost, cameras, points = solve_with_scipy(problem, settings)
    assert result.cost_after == pytest.approx(cost, rel=1e-5)
    distance, turn = pose_errors(result.cameras, result.points, cameras, points)
    assert distance < 1e-3
    assert turn < 1e-3


def test_agrees_with_colmap() -> None:
    pytest.importorskip("pycolmap")
    from prior.colmap_problem import adjust_with_colmap

    problem = make_problem(frames=8, points=200, noise=0.7)
    pixels = problem.observations.pixels.copy()
    pixels[::20] += 15.0
    observations = replace(problem.observations, pixels=pixels)
    result = adjust_bundle(
        problem.cameras, problem.points, observations, BundleSettings(tolerance=1e-12, iterations=100)
    )
    poses, points = adjust_with_colmap(problem.cameras, problem.points, observations, huber=1.0)
    cameras = [replace(camera, world_to_camera=pose) for camera, pose in zip(problem.cameras, poses, strict=True)]
    errors = np.linalg.norm(predicted(cameras, points, observations) - pixels, axis=1)
    assert result.cost_after == pytest.approx(huber_cost(errors, 1.0), rel=1e-6)
    distance, turn = pose_errors(result.cameras, result.points, cameras, points)
    assert distance < 1e-4
    assert turn < 1e-5


def test_exact_observations_give_the_truth() -> None:
    problem = make_problem()
    result = solve(problem)
    distance, turn = pose_errors(result.cameras, result.points, problem.true_cameras, problem.true_points)
    assert result.converged
    assert result.rmse_before > 5.0
    assert result.rmse_after < 1e-6
    assert distance < 1e-7
    assert turn < 1e-7


def test_reports_what_the_cameras_and_points_give() -> None:
    problem = make_problem(noise=0.5)
    result = solve(problem)
    for cameras, points, rmse in (
        (problem.cameras, problem.points, result.rmse_before),
        (result.cameras, result.points, result.rmse_after),
    ):
        errors = np.linalg.norm(predicted(cameras, points, problem.observations) - problem.observations.pixels, axis=1)
        assert rmse == pytest.approx(np.sqrt(np.mean(errors**2)))
    np.testing.assert_allclose(result.residuals, errors, rtol=1e-6, atol=1e-9)
    assert result.cost_after == pytest.approx(huber_cost(errors, 1.0))


def test_outliers_count_little() -> None:
    problem = make_problem(frames=8, points=150, views=5, noise=0.3)
    rng = np.random.default_rng(1)
    wrong = rng.random(len(problem.observations.frame)) < 0.1
    pixels = problem.observations.pixels + wrong[:, None] * rng.uniform(-60.0, 60.0, (len(wrong), 2))
    spoilt = replace(problem, observations=replace(problem.observations, pixels=pixels))
    robust, plain = solve(spoilt), solve(spoilt, BundleSettings(huber=1e6))
    truth = problem.true_cameras, problem.true_points
    distance, turn = pose_errors(robust.cameras, robust.points, *truth)
    assert distance < 0.02
    assert turn < 0.005
    assert pose_errors(plain.cameras, plain.points, *truth)[1] > 5 * turn
    assert np.median(robust.residuals[wrong]) > 10.0
    assert np.median(robust.residuals[~wrong]) < 0.5


def test_focal_lengths_stay_as_given() -> None:
    result = solve(make_problem(noise=0.5))
    assert {(camera.fx, camera.fy) for camera in result.cameras} == {(500.0, 520.0)}


def test_without_a_prior_the_first_camera_and_the_scale_stay() -> None:
    problem = make_problem(noise=0.5)
    result = solve(problem)
    np.testing.assert_allclose(result.cameras[0].world_to_camera, problem.cameras[0].world_to_camera, atol=1e-12)
    before, after = centres(problem.cameras), centres(result.cameras)
    farthest, axis = np.unravel_index(np.argmax(np.abs(before - before[0])), before.shape)
    assert after[farthest, axis] == pytest.approx(before[farthest, axis], abs=1e-12)
    assert np.abs(after[1:] - before[1:]).max() > 0.01


def test_a_prior_on_rotations_leaves_the_first_rotation_free() -> None:
    problem = make_problem(noise=0.5)
    result = solve(problem, BundleSettings(rotation_sigma=0.02))
    np.testing.assert_allclose(result.cameras[0].centre, problem.cameras[0].centre, atol=1e-12)
    assert np.abs(result.cameras[0].world_to_camera - problem.cameras[0].world_to_camera).max() > 1e-3


def test_a_prior_keeps_poses_in_the_frame_that_they_were_given_in() -> None:
    problem = make_problem(noise=0.3, pose_error=0.02)
    result = solve(problem, HELD)
    offsets = centres(result.cameras) - centres(problem.cameras)
    assert result.rmse_after < 0.6
    assert np.linalg.norm(offsets.mean(axis=0)) < 0.01
    before, after = (centres(cameras) - centres(problem.true_cameras) for cameras in (problem.cameras, result.cameras))
    assert np.sum(after**2) < np.sum(before**2)


def test_a_strong_prior_fixes_poses_and_points_follow() -> None:
    problem = make_problem(pose_error=0.0)
    result = solve(problem, BundleSettings(position_sigma=1e-7, rotation_sigma=1e-7))
    np.testing.assert_allclose(centres(result.cameras), centres(problem.true_cameras), atol=1e-7)
    np.testing.assert_allclose(result.points, problem.true_points, atol=1e-6)


def test_a_camera_that_sees_nothing_stays_where_the_prior_has_it() -> None:
    problem = make_problem()
    blind = turned_and_moved(problem.cameras[0], np.zeros(3), np.ones(3))
    result = adjust_bundle([*problem.cameras, blind], problem.points, problem.observations, HELD)
    np.testing.assert_allclose(result.cameras[-1].world_to_camera, blind.world_to_camera, atol=1e-12)


def test_every_number_of_threads_gives_the_same_bits() -> None:
    problem = make_problem(frames=10, points=500, noise=0.5)
    results = []
    before = numba.get_num_threads()
    try:
        for threads in (1, numba.config.NUMBA_NUM_THREADS):
            numba.set_num_threads(threads)
            results.append(solve(problem, HELD))
    finally:
        numba.set_num_threads(before)
    one, many = results
    np.testing.assert_array_equal(many.points, one.points)
    np.testing.assert_array_equal(many.cameras[3].world_to_camera, one.cameras[3].world_to_camera)


def test_the_matrix_of_many_cameras_is_not_copied() -> None:
    """With 700 cameras, each copy would take 141 MB. With so many, the points are in a single part."""
    problem = make_problem(frames=700, points=40, views=3)
    matrix_bytes = 8 * (6 * 700) ** 2
    tracemalloc.start()
    try:
        adjust_bundle(problem.cameras, problem.points, problem.observations, replace(HELD, iterations=1))
        assert tracemalloc.get_traced_memory()[1] < 1.2 * matrix_bytes
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("fixed", [0, 7])
def test_a_step_solves_the_damped_equations(fixed: int) -> None:
    rng = np.random.default_rng(0)
    cameras = make_problem(frames=50, points=4, views=2).cameras
    estimate = first_estimate(cameras, np.zeros((0, 3)))
    factor = rng.normal(size=(300, 320))
    lower, right, free = np.tril(factor @ factor.T), rng.normal(size=300), np.arange(300) >= fixed
    prior = pose_prior(estimate, 0.1, 0.2)
    equations = CameraEquations(lower.copy(), right, np.diag(lower).copy(), right)
    step, _ = _solve(equations, prior, estimate, 0.1, free)
    damped = np.tril(lower, -1) + np.tril(lower, -1).T
    damped += np.diag(np.diag(lower) + prior.weights + 0.1 * (np.diag(lower) + prior.weights))
    np.testing.assert_allclose(step[free], np.linalg.solve(damped[fixed:, fixed:], right[fixed:]), rtol=1e-9)
    np.testing.assert_array_equal(step[~free], 0.0)


def test_points_behind_a_camera_do_no_harm() -> None:
    problem = make_problem(noise=0.3)
    points = problem.points.copy()
    points[0] = problem.cameras[0].centre - 10.0 * problem.cameras[0].forward
    points[1] = problem.cameras[problem.observations.frame[problem.observations.point == 1][0]].centre
    result = adjust_bundle(problem.cameras, points, problem.observations, FREE)
    np.testing.assert_array_equal(result.points[0], points[0])
    assert np.all(result.residuals[problem.observations.point == 0] == BEHIND)
    assert np.median(result.residuals) < 1.0
    assert np.all(np.isfinite(result.points))


@settings(max_examples=40)
@given(
    seed=st.integers(0, 1000),
    pose_error=st.floats(0.0, 1.0),
    point_error=st.floats(0.0, 5.0),
    noise=st.floats(0.0, 50.0),
    huber=st.floats(1e-3, 1e3),
    sigma=st.none() | st.floats(1e-6, 1e3),
)
def test_the_cost_never_rises(
    seed: int, pose_error: float, point_error: float, noise: float, huber: float, sigma: float | None
) -> None:
    problem = make_problem(4, 15, 3, noise=noise, pose_error=pose_error, point_error=point_error, seed=seed)
    result = solve(problem, BundleSettings(huber, 15, sigma, sigma))
    assert result.cost_after <= result.cost_before
    assert np.isfinite(result.cost_after)
    assert np.all(np.isfinite(result.points))
    assert np.all(np.isfinite(result.residuals))


def test_adjusts_one_pose_to_known_points() -> None:
    problem = make_problem(points=100, views=6, pose_error=0.05, noise=0.3)
    own = np.flatnonzero(problem.observations.frame == 2)
    points = problem.true_points[problem.observations.point[own]]
    pixels = problem.observations.pixels[own]
    pixels[:5] += 40.0
    result = adjust_pose(problem.cameras[2], points, pixels, FREE)
    assert result.converged
    assert result.rmse_after < result.rmse_before
    assert np.median(result.residuals[5:]) < 0.6
    np.testing.assert_allclose(result.camera.centre, problem.true_cameras[2].centre, atol=0.01)
    held = adjust_pose(problem.cameras[2], points, pixels, BundleSettings(position_sigma=1e-8, rotation_sigma=1e-8))
    np.testing.assert_allclose(held.camera.world_to_camera, problem.cameras[2].world_to_camera, atol=1e-6)


def test_one_pose_agrees_with_scipy() -> None:
    problem = make_problem(points=80, views=6, noise=0.5)
    own = np.flatnonzero(problem.observations.frame == 1)
    points, pixels = problem.true_points[problem.observations.point[own]], problem.observations.pixels[own]
    tight = replace(FREE, tolerance=1e-14)
    result = adjust_pose(problem.cameras[1], points, pixels, tight)

    def robust(unknowns: np.ndarray) -> np.ndarray:
        camera = turned_and_moved(problem.cameras[1], unknowns[:3], unknowns[3:])
        length = np.linalg.norm(camera.project(points)[0] - pixels, axis=1)
        return np.sqrt(np.where(length < 1.0, length**2, 2 * length - 1.0))

    found = least_squares(robust, np.zeros(6), x_scale="jac", ftol=1e-12, xtol=1e-12)
    assert result.cost_after == pytest.approx(found.cost, rel=1e-6)
