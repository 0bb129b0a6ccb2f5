"""The decision to refine poses: by points and views that took no part and by photographs, and never without any."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from pocketgs.capture.capture import Capture, Frame
from pocketgs.geometry.camera import Camera
from pocketgs.prior.bundle.adjustment import BundleSettings
from pocketgs.prior.bundle.cpu.equations import CpuLinearizer
from pocketgs.prior.features.observations import Observations
from pocketgs.prior.poses import validation
from pocketgs.prior.poses.refinement import Refinement, refine
from pocketgs.prior.poses.robust_adjustment import RobustAdjustment
from pocketgs.prior.poses.validation import CHECKED_SHARE, _errors_of_views
from prior.bundle_problem import Problem, make_problem, position_errors, predicted, turned_and_moved

BUNDLE = BundleSettings(position_sigma=0.1, rotation_sigma=0.1)
PROBLEM = make_problem(frames=10, points=600, views=5, noise=0.2, pose_error=0.01)


def refined(problem: Problem, tracks: Observations) -> Refinement:
    order = np.lexsort((tracks.frame, tracks.point))
    blank = [np.zeros((camera.height, camera.width, 3), np.uint8) for camera in problem.cameras]
    return refine(adjustment_of(problem.cameras), tracks.select(order), blank, 4.0)


def adjustment_of(cameras: Sequence[Camera]) -> RobustAdjustment:
    return RobustAdjustment(cameras, 40.0, 0.5, BUNDLE, CpuLinearizer())


def errors(cameras: list[Camera]) -> float:
    return float(position_errors(cameras, PROBLEM.true_cameras).mean())


def test_poses_that_photographs_contradict_are_refined() -> None:
    found = refined(PROBLEM, PROBLEM.observations)
    assert found.moved.all()
    assert errors(found.cameras) < errors(PROBLEM.cameras)


def test_poses_are_kept_if_no_point_can_judge() -> None:
    tracks = PROBLEM.observations
    fitted_only = tracks.select(tracks.point % CHECKED_SHARE != 0)
    found = refined(PROBLEM, fitted_only)
    assert not found.moved.any()
    assert found.cameras == PROBLEM.cameras


def test_poses_that_fit_are_kept() -> None:
    exact = replace(PROBLEM, cameras=PROBLEM.true_cameras)
    assert not refined(exact, PROBLEM.observations).moved.any()


def features_seen_from(cameras: Sequence[Camera], tracks: Observations, points: np.ndarray) -> Observations:
    """The tracks as features would tell them if these were the true cameras."""
    return replace(tracks, pixels=predicted(cameras, points, tracks))


@pytest.mark.parametrize("features_are_right", [True, False])
def test_photographs_must_confirm_what_features_tell(clean_walk: Capture, features_are_right: bool) -> None:
    """Features that agree with each other, but are not where the photographs show them, move no camera."""
    frames, cloud, rng = clean_walk.train, clean_walk.points, np.random.default_rng(0)
    assert cloud is not None
    true = [frame.camera for frame in frames]
    stray = [turned_and_moved(camera, *rng.normal(0.0, 0.01, (2, 3))) for camera in true]
    given, told = (stray, true) if features_are_right else (true, stray)
    tracks, points = tracks_of(frames, cloud.positions)
    found = refine(adjustment_of(given), features_seen_from(told, tracks, points), [f.image for f in frames], 2.0)
    assert found.moved.any() == features_are_right


def tracks_of(frames: Sequence[Frame], points: np.ndarray) -> tuple[Observations, np.ndarray]:
    """Observations of the points that images contain, renumbered, and the points."""
    inside = []
    for frame in frames:
        pixels, depths = frame.camera.project(points)
        inside.append((depths > 0) & frame.camera.contains(pixels))
    visible = np.array(inside)
    shared = visible.sum(axis=0) >= 3
    point, view = np.nonzero(visible[:, shared].T)
    return Observations(view.astype(np.int32), point.astype(np.int32), np.zeros((len(view), 2))), points[shared]


def test_held_out_views_are_judged_on_the_same_observations_under_any_poses() -> None:
    order = np.lexsort((PROBLEM.observations.frame, PROBLEM.observations.point))
    tracks = PROBLEM.observations.select(order)
    absent = np.arange(len(PROBLEM.cameras)) == 4
    halves = np.flatnonzero(tracks.frame == 4)
    for cameras in (PROBLEM.cameras, PROBLEM.true_cameras):
        judged = np.flatnonzero(np.isfinite(_errors_of_views(cameras, tracks, absent, 3.0, BUNDLE)))
        assert len(judged) > 50
        assert np.isin(judged, halves[1::2]).all()


def test_poses_that_hardly_fit_better_are_kept() -> None:
    """Of noise alone, an adjustment makes points fit a little better, also those that took no part."""
    problem = make_problem(frames=10, points=600, views=5, noise=0.5, pose_error=3e-4)
    assert not refined(problem, problem.observations).moved.any()


@pytest.mark.parametrize(("pose_error", "moved"), [(6e-4, True), (2e-4, False)])
def test_held_out_views_must_fit_the_points_of_the_others_as_well(
    monkeypatch: pytest.MonkeyPatch, pose_error: float, moved: bool
) -> None:
    """Here only they tell: the least gain that is asked of points would keep the better poses."""
    monkeypatch.setattr(validation, "MIN_GAIN", 0.0)
    problem = make_problem(frames=10, points=600, views=5, noise=0.5, pose_error=pose_error)
    assert refined(problem, problem.observations).moved.any() == moved
