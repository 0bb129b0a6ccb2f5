"""The decision to refine poses: by points and views that took no part, and never without any."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pocketgs.geometry.camera import Camera
from pocketgs.prior.bundle.adjustment import BundleSettings
from pocketgs.prior.bundle.schur import CpuAdjuster
from pocketgs.prior.features.observations import Observations
from pocketgs.prior.poses.refinement import CHECKED_SHARE, Refinement, refine
from prior.bundle_problem import Problem, make_problem, position_errors

BUNDLE = BundleSettings(position_sigma=0.1, rotation_sigma=0.1)
PROBLEM = make_problem(frames=10, points=600, views=5, noise=0.2, pose_error=0.01)


def refined(problem: Problem, tracks: Observations) -> Refinement:
    order = np.lexsort((tracks.frame, tracks.point))
    return refine(problem.cameras, tracks.select(order), 40.0, 0.5, BUNDLE, 4.0, CpuAdjuster())


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
