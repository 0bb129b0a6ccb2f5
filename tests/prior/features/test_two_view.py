"""Two-view geometry: matches that one rigid motion explains, whatever the poses."""

from __future__ import annotations

import numpy as np
import pytest

from pocketgs.geometry.camera import Camera
from pocketgs.prior.features.cpu.finder import CpuFinder
from pocketgs.prior.features.features import Features
from pocketgs.prior.features.two_view import VERIFICATION, agreeing, match_views
from prior.bundle_problem import Problem, make_problem, turned_and_moved

CAMERA = Camera(640, 480, 500.0, 500.0, 320.0, 240.0, np.eye(4))


def seen_twice(count: int) -> tuple[Problem, np.ndarray, np.ndarray]:
    """A problem, and the pixels of its points in two views."""
    problem = make_problem(points=count)
    first, second = (camera.project(problem.true_points)[0] for camera in problem.true_cameras[1:3])
    return problem, first, second


def test_matches_of_one_motion_agree() -> None:
    problem, first, second = seen_twice(100)
    wrong = np.arange(100) % 3 == 0
    second[wrong] = np.random.default_rng(0).uniform(0, [640, 480], (wrong.sum(), 2))
    found = agreeing(*problem.cameras[1:3], first, second, VERIFICATION)
    assert found[~wrong].mean() > 0.95
    assert found[wrong].mean() < 0.15


@pytest.mark.parametrize("count", [0, 1, 6, 8, 20, 200])
def test_random_pairs_do_not_agree(count: int) -> None:
    rng = np.random.default_rng(count)
    found = agreeing(CAMERA, CAMERA, *rng.uniform(0, 480, (2, count, 2)), VERIFICATION)
    assert found.shape == (count,)
    assert not found.any()


def test_matches_in_one_place_do_not_crash() -> None:
    found = agreeing(CAMERA, CAMERA, np.full((30, 2), 5.0), np.full((30, 2), 7.0), VERIFICATION)
    assert found.shape == (30,)


def test_given_poses_do_not_count() -> None:
    problem = make_problem(frames=3, views=3, points=120)
    rng = np.random.default_rng(0)
    descriptors = np.abs(rng.normal(size=(120, 128))).astype(np.float32)
    descriptors /= np.linalg.norm(descriptors, axis=1, keepdims=True)
    features = [Features(camera.project(problem.true_points)[0], descriptors) for camera in problem.true_cameras]
    wrong = np.arange(120) % 4 == 0
    features[1].pixels[wrong] = rng.uniform(0, [640, 480], (wrong.sum(), 2))
    features[2] = Features(rng.uniform(0, [640, 480], (120, 2)), descriptors)
    astray = [turned_and_moved(camera, *rng.normal(size=(2, 3))) for camera in problem.cameras]
    matches = match_views(astray, features, [(0, 1), (0, 2), (1, 2)], CpuFinder())
    assert list(matches) == [(0, 1)]
    np.testing.assert_array_equal(matches[0, 1][:, 0], matches[0, 1][:, 1])
    found = np.isin(np.arange(120), matches[0, 1][:, 0])
    assert found[~wrong].mean() > 0.95
    assert found[wrong].sum() <= 4
