"""The GPU's normal equations against the CPU's, and adjustments that use them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pocketgs.geometry.camera import Camera, look_at
from pocketgs.prior.bundle.adjustment import BundleResult, BundleSettings, adjust_bundle
from pocketgs.prior.bundle.cpu.equations import CpuEquations, CpuLinearizer
from pocketgs.prior.bundle.equations import CameraEquations, Linearizer
from pocketgs.prior.bundle.problem import by_point, first_estimate
from pocketgs.prior.bundle.reprojection import Sightings
from pocketgs.prior.bundle.webgpu.equations import WebGpuLinearizer
from prior.bundle_problem import Problem, make_problem

pytestmark = pytest.mark.usefixtures("adapter")

HUBER, DAMPING = 3.0, 1e-3
HELD = BundleSettings(position_sigma=0.02, rotation_sigma=0.02)


@pytest.fixture(scope="module")
def linearizer() -> Linearizer:
    return WebGpuLinearizer()


def sightings_of(problem: Problem) -> Sightings:
    order = np.argsort(problem.observations.point, kind="stable")
    return by_point(problem.cameras, len(problem.points), problem.observations, order)


def twice_in_one_frame(problem: Problem) -> Problem:
    seen = problem.observations
    return replace(problem, observations=seen.select(np.append(np.arange(len(seen.frame)), [0, 0, 5])))


def with_a_blind_camera_and_points_behind(problem: Problem) -> Problem:
    blind = replace(problem.cameras[0], world_to_camera=look_at(np.array([3.0, 0, 0]), np.zeros(3), np.eye(3)[1]))
    points = problem.points.copy()
    points[:3] = [0.0, 0.0, -40.0]
    return replace(problem, cameras=[*problem.cameras, blind], points=points)


PROBLEMS = {
    "small": make_problem(frames=4, points=20, views=3, noise=1.0),
    "many points": make_problem(frames=12, points=700, views=6, noise=2.0),
    "twice in one frame": twice_in_one_frame(make_problem(frames=4, points=20, views=3, noise=1.0)),
    "blind, and behind": with_a_blind_camera_and_points_behind(make_problem(noise=1.0)),
    "two cameras": make_problem(frames=2, points=9, views=2, noise=1.0),
}


@pytest.fixture(params=PROBLEMS)
def problem(request: pytest.FixtureRequest) -> Problem:
    return PROBLEMS[request.param]


def in_units_of_the_diagonal(equations: CameraEquations) -> tuple[np.ndarray, ...]:
    """Entries as shares of what they are sums of, so that they can be compared; unknowns without evidence are 0."""
    unit = np.where(equations.diagonal > 0, np.sqrt(equations.diagonal), 1.0)
    matrix = np.tril(equations.matrix / np.outer(unit, unit))
    return matrix, equations.diagonal / unit**2, equations.right / unit, equations.gradient / unit


def test_equations_and_steps_agree_with_the_cpu(linearizer: Linearizer, problem: Problem) -> None:
    sightings, estimate = sightings_of(problem), first_estimate(problem.cameras, problem.points)
    found, expected = linearizer.equations(sightings, HUBER), CpuEquations(sightings, HUBER)
    one, other = found.reduced(estimate, DAMPING), expected.reduced(estimate, DAMPING)
    for mine, theirs in zip(in_units_of_the_diagonal(one), in_units_of_the_diagonal(other), strict=True):
        np.testing.assert_allclose(mine, theirs, atol=1e-5 * np.abs(theirs).max())
    step = 1e-3 * np.random.default_rng(1).normal(size=len(one.right))
    (moves, decrease), (expected_moves, expected_decrease) = found.point_steps(step), expected.point_steps(step)
    np.testing.assert_allclose(moves, expected_moves, atol=1e-4 * np.abs(expected_moves).max())
    assert decrease == pytest.approx(expected_decrease, rel=1e-4)


def test_same_bits_every_time(linearizer: Linearizer) -> None:
    problem = PROBLEMS["many points"]
    estimate = first_estimate(problem.cameras, problem.points)
    first, second = (linearizer.equations(sightings_of(problem), HUBER).reduced(estimate, DAMPING) for _ in range(2))
    for one, other in zip(first, second, strict=True):
        np.testing.assert_array_equal(one, other)


def of_size(problem: Problem, size: float) -> Problem:
    """The problem in other units, and far from the origin."""

    def resized(camera: Camera) -> Camera:
        pose = camera.world_to_camera.copy()
        pose[:3, 3] = -pose[:3, :3] @ (size * (camera.centre + 100.0))
        return replace(camera, world_to_camera=pose)

    cameras = [resized(camera) for camera in problem.cameras]
    return replace(problem, cameras=cameras, points=size * (problem.points + 100.0))


@pytest.mark.parametrize("size", [1e-6, 1.0, 1e6])
def test_adjustments_end_as_on_the_cpu(linearizer: Linearizer, size: float) -> None:
    problem = of_size(make_problem(frames=8, points=200, views=5, noise=0.5), size)
    settings = replace(HELD, position_sigma=0.02 * size)

    def adjusted(device: Linearizer) -> BundleResult:
        return adjust_bundle(problem.cameras, problem.points, problem.observations, settings, linearizer=device)

    found, expected = adjusted(linearizer), adjusted(CpuLinearizer())
    assert found.converged
    assert found.cost_after == pytest.approx(expected.cost_after, rel=1e-6)
    for one, other in zip(found.cameras, expected.cameras, strict=True):
        np.testing.assert_allclose(one.centre / size, other.centre / size, atol=2e-4)
        np.testing.assert_allclose(one.world_to_camera[:3, :3], other.world_to_camera[:3, :3], atol=2e-4)


def test_points_with_hardly_any_parallax_do_no_harm(linearizer: Linearizer) -> None:
    problem = make_problem(frames=6, points=120, views=4, noise=0.5)
    points = problem.points.copy()
    points[:40] += np.array([0.0, 0.0, 1e5])
    seen = problem.observations
    result = adjust_bundle(problem.cameras, points, seen, HELD, linearizer=linearizer)
    assert result.cost_after < 0.2 * result.cost_before
    assert all(np.isfinite(camera.world_to_camera).all() for camera in result.cameras)


def test_what_the_memory_does_not_hold_is_computed_on_the_cpu() -> None:
    few = WebGpuLinearizer(max_memory=1)
    problem = make_problem(frames=30, points=3000, views=10)
    assert isinstance(few.equations(sightings_of(problem), HUBER), CpuEquations)


def test_one_linearizer_takes_one_problem_after_another(linearizer: Linearizer) -> None:
    """A buffer that is too large for a smaller problem must not be read beyond it."""
    for name in ("many points", "small"):
        problem = PROBLEMS[name]
        sightings, estimate = sightings_of(problem), first_estimate(problem.cameras, problem.points)
        found = linearizer.equations(sightings, HUBER).reduced(estimate, DAMPING)
        expected = CpuEquations(sightings, HUBER).reduced(estimate, DAMPING)
        np.testing.assert_allclose(found.right, expected.right, rtol=1e-3, atol=1e-4 * np.abs(expected.right).max())
    linearizer.release()
