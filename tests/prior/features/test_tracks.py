"""Tracks: linking matches, triangulation, and the measures that sort good points from bad ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pocketgs.geometry.camera import Camera, look_at
from pocketgs.prior.features.features import Features
from pocketgs.prior.features.observations import Observations
from pocketgs.prior.features.tracks import (
    link,
    reprojection_errors,
    triangulate,
    triangulation_angles,
    view_distances,
)
from prior.bundle_problem import Problem, make_problem, turned_and_moved


def camera_at(eye: tuple[float, float, float], target: tuple[float, float, float]) -> Camera:
    return Camera(640, 480, 500.0, 520.0, 318.0, 243.0, look_at(np.array(eye), np.array(target), np.array([0.0, 0, 1])))


def numbered(*counts: int) -> list[Features]:
    """A view for each count, whose feature i lies at (view, i)."""
    return [
        Features(np.stack([np.full(count, float(view)), np.arange(float(count))], axis=1), np.zeros((count, 128)))
        for view, count in enumerate(counts)
    ]


def tracks_of(features: list[Features], matches: dict[tuple[int, int], list[tuple[int, int]]]) -> set[frozenset]:
    """Tracks, as sets of (view, feature)."""
    seen, feature = link(features, {pair: np.array(found) for pair, found in matches.items()})
    members: dict[int, set] = {}
    for frame, point, number in zip(seen.frame, seen.point, feature, strict=True):
        members.setdefault(int(point), set()).add((int(frame), int(number)))
    assert sorted(members) == list(range(len(members)))
    return {frozenset(track) for track in members.values()}


def test_matches_are_chained() -> None:
    found = tracks_of(numbered(4, 4, 4), {(0, 1): [(0, 3), (2, 1)], (1, 2): [(3, 2)], (0, 2): [(3, 0)]})
    assert found == {frozenset({(0, 0), (1, 3), (2, 2)}), frozenset({(0, 2), (1, 1)}), frozenset({(0, 3), (2, 0)})}


def test_a_loop_of_matches_is_one_track() -> None:
    found = tracks_of(numbered(2, 2, 2), {(0, 1): [(1, 1)], (1, 2): [(1, 1)], (0, 2): [(1, 1)]})
    assert found == {frozenset({(0, 1), (1, 1), (2, 1)})}


def test_a_track_that_meets_a_view_twice_is_dropped() -> None:
    found = tracks_of(numbered(4, 4, 4), {(0, 1): [(0, 0), (1, 1)], (1, 2): [(0, 0)], (0, 2): [(2, 0), (3, 3)]})
    assert found == {frozenset({(0, 1), (1, 1)}), frozenset({(0, 3), (2, 3)})}


@pytest.mark.parametrize("counts", [(0, 0), (5, 0, 5), (1,)])
def test_nothing_matched_gives_no_tracks(counts: tuple[int, ...]) -> None:
    seen, feature = link(numbered(*counts), {})
    assert len(seen) == len(feature) == 0
    assert seen.pixels.shape == (0, 2)
    assert triangulate(exact().true_cameras, seen).shape == (0, 3)


@settings(max_examples=60)
@given(seed=st.integers(0, 10_000), views=st.integers(2, 6), count=st.integers(1, 8), share=st.floats(0, 1))
def test_tracks_are_sound_whatever_the_matches(seed: int, views: int, count: int, share: float) -> None:
    rng = np.random.default_rng(seed)
    features = numbered(*rng.integers(count, 2 * count, views))
    matches = {
        (first, second): np.stack([rng.permutation(count)[:chosen] for _ in range(2)], axis=1)
        for first in range(views)
        for second in range(first + 1, views)
        if (chosen := int(rng.binomial(count, share))) > 0
    }
    seen, feature = link(features, matches)
    places = list(zip(seen.point.tolist(), seen.frame.tolist(), strict=True))
    assert places == sorted(set(places))
    assert np.all(np.bincount(seen.point) >= 2)
    np.testing.assert_array_equal(seen.pixels, np.stack([seen.frame, feature], axis=1))


def exact() -> Problem:
    return make_problem(frames=8, points=50, views=5)


def test_triangulation_is_exact_without_noise() -> None:
    problem = exact()
    points = triangulate(problem.true_cameras, problem.observations)
    np.testing.assert_allclose(points, problem.true_points, atol=1e-9)
    assert reprojection_errors(problem.true_cameras, points, problem.observations).max() < 1e-6


def test_triangulation_errs_by_little_more_than_the_least_reprojection_error() -> None:
    problem = make_problem(frames=8, points=200, views=5, noise=0.5)
    points = triangulate(problem.true_cameras, problem.observations)
    errors = reprojection_errors(problem.true_cameras, points, problem.observations)
    # Of the 2 x 5 coordinates of a track, three are spent on the point.
    assert np.sqrt(np.mean(errors**2)) == pytest.approx(0.5 * np.sqrt(2 * 7 / 10), rel=0.05)


def test_one_wrong_ray_is_outvoted() -> None:
    problem = exact()
    wrong = np.unique(problem.observations.point, return_index=True)[1]
    pixels = problem.observations.pixels.copy()
    pixels[wrong] += np.random.default_rng(0).choice([-40.0, 40.0], (50, 2))
    spoilt = replace(problem.observations, pixels=pixels)
    points = triangulate(problem.true_cameras, spoilt)
    errors = reprojection_errors(problem.true_cameras, points, spoilt)
    right = np.setdiff1d(np.arange(len(pixels)), wrong)
    assert np.median(errors[right]) < 1.0
    assert errors[right].max() < 4.0
    assert errors[wrong].min() > 30.0


def test_parallel_rays_meet_nowhere() -> None:
    cameras = [turned_and_moved(exact().true_cameras[0], np.zeros(3), offset) for offset in np.eye(3)]
    ahead = Observations(np.array([0, 1, 2, 0, 1, 2]), np.repeat([0, 1], 3), np.tile([[318.0, 243.0]], (6, 1)))
    point = cameras[0].centre + 3.0 * cameras[0].forward
    ahead.pixels[3:] = np.concatenate([camera.project(point[None])[0] for camera in cameras])
    points = triangulate(cameras, ahead)
    assert not np.isfinite(points[0]).any()
    np.testing.assert_allclose(points[1], point, atol=1e-6)
    errors = reprojection_errors(cameras, points, ahead)
    assert not np.any(errors[:3] < 1e9)


def test_reprojection_errors_are_in_pixels() -> None:
    camera = camera_at((0, -3, 0), (0, 0, 0))
    points = np.array([[0.0, 0.0, 0.0], [0.0, -6.0, 0.0], [0.1, 0.2, 0.3]])
    pixels = camera.project(points)[0] + [[3.0, 4.0], [0.0, 0.0], [0.0, 0.0]]
    errors = reprojection_errors([camera], points, Observations(np.zeros(3, int), np.arange(3), pixels))
    np.testing.assert_allclose(errors, [5.0, np.inf, 0.0], atol=1e-9)


@pytest.mark.parametrize("distance", [0.5, 3.0, 30.0])
def test_angle_between_two_rays(distance: float) -> None:
    cameras = [camera_at((x, -distance, 0), (0, 0, 0)) for x in (-1, 1)]
    seen = Observations(np.array([0, 1]), np.zeros(2, int), np.zeros((2, 2)))
    angles = triangulation_angles(cameras, np.zeros((1, 3)), seen)
    np.testing.assert_allclose(angles, 2 * np.arctan(1 / distance))


def test_angle_of_more_rays_is_that_of_the_outermost() -> None:
    cameras = [camera_at((np.sin(angle), -np.cos(angle), 0), (0, 0, 0)) for angle in (-0.2, -0.05, 0.05, 0.2)]
    seen = Observations(np.arange(4), np.zeros(4, int), np.zeros((4, 2)))
    np.testing.assert_allclose(triangulation_angles(cameras, np.zeros((1, 3)), seen), 0.4)


def test_a_point_seen_once_or_never_spans_no_angle() -> None:
    seen = Observations(np.array([0]), np.array([1]), np.zeros((1, 2)))
    assert np.all(triangulation_angles([camera_at((0, -3, 0), (0, 0, 0))], np.zeros((2, 3)), seen) < 1e-6)


def test_views_differ_by_place_and_direction() -> None:
    here, aside, turned = (
        camera_at((0, 0, 0), (0, 1, 0)),
        camera_at((3, 4, 0), (3, 5, 0)),
        camera_at((0, 0, 0), (1, 0, 0)),
    )
    apart = view_distances([here, aside], [here, aside, turned], scene_distance=2.0)
    np.testing.assert_allclose(apart, [[0, 2.5, np.sqrt(2)], [2.5, 0, 2.5 + np.sqrt(2)]], atol=1e-12)
    assert view_distances([], [here, aside], 2.0).shape == (0, 2)
