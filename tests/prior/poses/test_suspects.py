"""Groups of views, some of which have wrong poses, from matches of known points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pocketgs.geometry.camera import Camera
from pocketgs.prior.features.features import Features
from pocketgs.prior.features.pairs import Pair
from pocketgs.prior.poses.suspects import contradicted, unmatched_views
from prior.bundle_problem import make_problem

VIEWS, POINTS, TOLERANCE = 8, 200, 2.0
PROBLEM = make_problem(frames=VIEWS, points=POINTS)
APART = [6, 7]
"""Two views that match each other well and the others badly."""


def with_wrong_poses() -> list[Camera]:
    """The cameras, of which the two are moved as one, so that they fit each other."""
    motion = np.eye(4)
    motion[:3, :3], motion[:3, 3] = Rotation.from_rotvec([0.2, 0.3, 0.6]).as_matrix(), [1.0, 0.3, 0.5]
    return [
        replace(camera, world_to_camera=camera.world_to_camera @ motion) if view in APART else camera
        for view, camera in enumerate(PROBLEM.true_cameras)
    ]


def features_of(cameras: Sequence[Camera]) -> list[Features]:
    """What the cameras see of the same points, in the same order."""
    descriptors = Features.none().descriptors
    return [Features(camera.project(PROBLEM.true_points)[0], descriptors) for camera in cameras]


def all_matches(right: int, wrong: int) -> dict[Pair, np.ndarray]:
    """All matches in the group of most views and in that of two; between these a right pair and two wrong ones."""
    everything = np.column_stack([np.arange(POINTS)] * 2)
    mixed = everything.copy()
    mixed[:, 1] = np.random.default_rng(1).permutation(POINTS)
    return {
        **{(one, other): everything for other in range(APART[0]) for one in range(other)},
        (6, 7): everything,
        (5, 6): everything[:right],
        (4, 6): mixed[: wrong // 2],
        (4, 7): mixed[wrong // 2 : wrong],
    }


def test_correct_views_with_few_matches() -> None:
    """Most of them may be wrong, as long as enough are right."""
    cameras = PROBLEM.true_cameras
    assert not contradicted(cameras, features_of(cameras), all_matches(30, 48), TOLERANCE).any()


def test_groups_with_few_matches_say_nothing() -> None:
    """Between two halves of the views, all of them right, pairs that share nothing have a few matches each."""
    cameras, within = PROBLEM.true_cameras, np.column_stack([np.arange(POINTS)] * 2)
    mixed = within.copy()
    mixed[:, 1] = np.random.default_rng(1).permutation(POINTS)
    halves = range(VIEWS // 2), range(VIEWS // 2, VIEWS)
    matches = {(one, other): within for half in halves for one in half for other in half if one < other}
    matches |= {(one, one + VIEWS // 2): mixed[20 * one :][:20] for one in halves[0]}
    assert not contradicted(cameras, features_of(cameras), matches, TOLERANCE).any()
    matches |= {(one, one + VIEWS // 2): mixed[40 * one :][:40] for one in halves[0]}
    assert contradicted(cameras, features_of(cameras), matches, TOLERANCE).sum() == VIEWS // 2


@pytest.mark.parametrize(("by_chance", "wrong"), [(0, 70), (20, 120)])
def test_wrong_views_that_agree_with_each_other(by_chance: int, wrong: int) -> None:
    """A pair that fits by chance, as on an object that looks the same from both sides, does not save them."""
    cameras, features, matches = with_wrong_poses(), features_of(PROBLEM.true_cameras), all_matches(0, wrong)
    fitting = features_of(cameras)
    for view in (5, 6):
        pixels = np.concatenate([features[view].pixels, fitting[view].pixels])
        features[view] = replace(features[view], pixels=pixels)
    matches[5, 6] = np.column_stack([np.arange(by_chance)] * 2) + POINTS
    assert np.flatnonzero(contradicted(cameras, features, matches, TOLERANCE)).tolist() == APART


def test_too_few_matches_say_nothing() -> None:
    features = features_of(PROBLEM.true_cameras)
    assert not contradicted(with_wrong_poses(), features, all_matches(0, 30), TOLERANCE).any()


def test_a_view_without_matches_among_views_that_match() -> None:
    """It shows another place, unless it has few features, or the others often match none of their nearest either."""
    cameras, everything = PROBLEM.true_cameras, np.column_stack([np.arange(POINTS)] * 2)
    features, lone = features_of(cameras), 3
    matches = {(one, other): everything for other in range(VIEWS) for one in range(other) if lone not in (one, other)}
    assert np.flatnonzero(unmatched_views(cameras, features, matches, 1.0)).tolist() == [lone]
    poor = [
        replace(view, pixels=view.pixels[: POINTS // 3 if number == lone else POINTS])
        for number, view in enumerate(features)
    ]
    assert not unmatched_views(cameras, poor, matches, 1.0).any()
    few = {pair: found for pair, found in matches.items() if sum(pair) % 3 == 0}
    assert not unmatched_views(cameras, features, few, 1.0).any()
