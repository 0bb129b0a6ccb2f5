"""The geometry prior from end to end: from a phone's walk to refined poses and a cloud on the surface."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree

from pocketgs import Capture
from pocketgs.capture import open_capture
from pocketgs.capture.capture import Frame
from pocketgs.capture.synthetic import (
    GroundTruth,
    demo_capture,
    demo_ground_truth,
    read_ground_truth,
    true_capture,
    write_demo,
)
from pocketgs.cli.run_lines import prior_line
from pocketgs.prior.cloud.complete import GUESSED_CONFIDENCE
from pocketgs.prior.poses.structure import StructureSettings
from pocketgs.prior.prior import PreparedCapture, PriorSettings, build_prior
from pocketgs.training.options import TrainingOptions
from pocketgs.training.preparation import prepare
from prior.bundle_problem import centres, similarity

SIZES = 200, 150, 20
SETTINGS = PriorSettings()


@pytest.fixture(scope="module")
def walk() -> Capture:
    return demo_capture(*SIZES)


@pytest.fixture(scope="module")
def truth() -> GroundTruth:
    return demo_ground_truth(*SIZES)


@pytest.fixture(scope="module")
def prior(walk: Capture) -> PreparedCapture:
    return build_prior(walk, 5000, SETTINGS)


def camera_errors(frames: list[Frame], truth: GroundTruth) -> np.ndarray:
    """(F,) distances in metres of the cameras from where they truly are, after a similarity."""
    cameras = [frame.camera for frame in frames]
    true_centres = centres([truth.cameras[frame.name] for frame in frames])
    scale, rotation, offset = similarity(centres(cameras), true_centres)
    return np.linalg.norm(scale * centres(cameras) @ rotation.T + offset - true_centres, axis=1)


def true_positions(prior: PreparedCapture, truth: GroundTruth) -> np.ndarray:
    """(N, 3) the cloud in the true world: moved by the similarity that takes the cameras nearest to the true ones."""
    assert prior.points is not None
    cameras = [frame.camera for frame in prior.frames]
    true_centres = centres([truth.cameras[frame.name] for frame in prior.frames])
    scale, rotation, offset = similarity(centres(cameras), true_centres)
    return np.asarray(scale * prior.points.positions.astype(np.float64) @ rotation.T + offset)


def distances_along_rays(positions: np.ndarray, truth: GroundTruth, names: list[str]) -> np.ndarray:
    """(N,) of each point's relative distances |z / true depth - 1| in the true frames that have it in view, the least.

    The true depth is that of the pixel that the point falls in. Infinite for points that no frame has in view.
    """
    least = np.full(len(positions), np.inf)
    for name in names:
        camera, true_depth = truth.cameras[name], truth.depths[name]
        pixels, depth = camera.project(positions)
        seen = (depth > 0) & np.all((pixels >= 0) & (pixels < (camera.width, camera.height)), axis=1)
        columns, rows = pixels[seen].astype(int).T
        error = np.abs(depth[seen] / true_depth[rows, columns] - 1)
        least[seen] = np.minimum(least[seen], error)
    return least


def surface(truth: GroundTruth, names: list[str], step: int) -> np.ndarray:
    """(M, 3) true surface points of the frames, one per `step` x `step` pixels."""
    points = []
    for name in names:
        camera, depth = truth.cameras[name], truth.depths[name]
        rows, columns = (
            grid.ravel() for grid in np.mgrid[step // 2 : camera.height : step, step // 2 : camera.width : step]
        )
        local = [(columns + 0.5 - camera.cx) / camera.fx, (rows + 0.5 - camera.cy) / camera.fy, np.ones(rows.size)]
        points.append(
            camera.centre + np.stack(local, axis=1) * depth[rows, columns, None] @ camera.world_to_camera[:3, :3]
        )
    return np.concatenate(points)


def test_poses_and_cloud_of_a_walk(walk: Capture, prior: PreparedCapture, truth: GroundTruth) -> None:
    before, after = camera_errors(walk.frames, truth), camera_errors(prior.frames, truth)
    assert after.mean() < 0.4 * before.mean()
    assert prior.points is not None
    assert prior.points.confidences is not None
    errors = distances_along_rays(true_positions(prior, truth), truth, [frame.name for frame in walk.train])
    assert np.median(errors) < 0.015
    # Other views confirm about half of the points. The images are small: what one pixel covers is 1 % of the distance.
    confirmed = prior.points.confidences > SETTINGS.fusion.confidence / 2
    assert np.mean(confirmed) > 0.4
    assert np.mean(errors[confirmed] < 0.03) > 0.8
    assert np.mean(errors[confirmed] < 0.03) > np.mean(errors[~confirmed] < 0.03)


def test_frames_stay_what_they_were(walk: Capture, prior: PreparedCapture) -> None:
    assert [frame.name for frame in prior.frames] == [frame.name for frame in walk.frames]
    for frame, before in zip(prior.held_out, walk.held_out, strict=True):
        assert frame.image is before.image
    for frame, before in zip(prior.frames, walk.frames, strict=True):
        assert frame.camera.fx == before.camera.fx
        assert frame.image.shape == before.image.shape
    assert walk.points is None


def test_report_is_of_what_was_done(walk: Capture, prior: PreparedCapture) -> None:
    report = prior.report
    assert report is not None
    assert [decision.name for decision in report.decisions] == [frame.name for frame in walk.train]
    assert 2 <= report.keyframes == sum(decision.kept for decision in report.decisions) <= len(walk.train)
    assert report.coverage is not None
    assert report.coverage_known is not None
    assert 0.3 < report.coverage_known <= report.coverage <= 1
    assert 0 <= report.guessed < report.points
    assert all(decision.reason for decision in report.decisions)
    assert report.poses_refined
    assert report.rmse is not None
    assert report.rmse_given is not None
    assert report.rmse < 0.7 < report.rmse_given
    assert report.sparse_points > 50
    assert prior.points is not None
    assert 4000 < report.points == len(prior.points) <= 5000
    assert "poses refined" in prior_line(report)
    assert f"cloud of {report.points:,} points" in prior_line(report)


def test_sparse_cloud(walk: Capture) -> None:
    found = build_prior(walk, 5000, replace(SETTINGS, dense=False))
    cloud = found.points
    assert found.report is not None
    assert cloud is not None
    assert len(cloud) == found.report.points == found.report.sparse_points > 50
    assert cloud.colours.min() >= 0
    assert cloud.colours.max() <= 1
    # Each has the colour of a pixel near where some frame sees it.
    best = np.full(len(cloud), np.inf)
    for frame in found.train:
        pixels, depth = frame.camera.project(cloud.positions.astype(np.float64))
        seen = (depth > 0) & np.all((pixels >= 0) & (pixels < frame.image.shape[1::-1]), axis=1)
        columns, rows = pixels[seen].astype(int).T
        shown = frame.image[rows, columns] / 255
        best[seen] = np.minimum(best[seen], np.abs(shown - cloud.colours[seen]).max(axis=1))
    assert np.median(best) < 0.05


def test_only_gains_that_were_undone_are_reported(walk: Capture) -> None:
    alpha = np.full(walk.train[0].image.shape[:2], 255, np.uint8)
    alpha[:5] = 0
    cut_out = [replace(frame, alpha=alpha) for frame in walk.train]
    settings = replace(SETTINGS, dense=False, exposure="on", structure=StructureSettings(bundle=False))
    train = [*cut_out[:5], *walk.train[5:]]
    found = build_prior(replace(walk, train=train), 5000, settings)
    assert found.report is not None
    assert found.report.gains is not None
    changed = [not np.array_equal(old.image, new.image) for old, new in zip(train, found.train, strict=True)]
    assert changed == [False] * 5 + [True] * (len(train) - 5)
    assert np.any(found.report.gains != 1.0, axis=1).tolist() == changed
    whole = build_prior(replace(walk, train=cut_out), 5000, settings).report
    assert whole is not None
    assert whole.gains is None


def test_poses_stay_where_asked(walk: Capture) -> None:
    settings = replace(SETTINGS, dense=False, structure=StructureSettings(bundle=False), exposure="off")
    found = build_prior(walk, 5000, settings)
    assert found.report is not None
    assert not found.report.poses_refined
    assert found.report.gains is None
    for frame, before in zip(found.frames, walk.frames, strict=True):
        assert frame.camera is before.camera
        assert frame.image is before.image


def test_true_poses_are_kept() -> None:
    capture = true_capture(200, 150, frames=6, points=10)
    found = build_prior(capture, 4000, SETTINGS)
    assert found.report is not None
    assert found.points is not None
    assert not found.report.poses_refined
    assert found.report.gains is None
    assert found.frames == capture.frames
    cameras = {frame.name: frame.camera for frame in capture.train}
    depths = {frame.name: frame.depth for frame in capture.train if frame.depth is not None}
    positions = found.points.positions.astype(np.float64)
    errors = distances_along_rays(positions, GroundTruth(cameras, depths), list(cameras))
    assert np.mean(errors < 0.03) > 0.8


def test_a_capture_without_texture_goes_on_with_a_warning(walk: Capture) -> None:
    grey = [replace(frame, image=np.full_like(frame.image, 90)) for frame in walk.train[:5]]
    found = build_prior(replace(walk, train=grey), 5000, SETTINGS)
    assert found.report is not None
    assert found.points is not None
    assert len(found.points) == found.report.points <= 5000
    assert np.isfinite(found.points.positions).all()
    assert (found.report.rmse, found.report.sparse_points, found.report.poses_refined) == (None, 0, False)
    assert any("too little texture" in warning for warning in found.report.warnings)
    assert json.dumps(asdict(found.report))
    assert "sparse points" not in prior_line(found.report)
    for frame, before in zip(found.train, walk.train, strict=False):
        assert frame.camera is before.camera


@pytest.mark.parametrize("count", [1, 2])
def test_hardly_any_frames(walk: Capture, count: int) -> None:
    found = build_prior(replace(walk, train=walk.train[:count], held_out=[]), 5000, SETTINGS)
    assert found.report is not None
    assert [decision.kept for decision in found.report.decisions] == [True] * count
    assert len(found.train) == count
    # Of one photograph no depth is known: all is guessed.
    assert found.report.points == found.report.guessed or count == 2


@pytest.mark.slow
def test_demo(tmp_path: Path) -> None:
    """The demo's own effort on a quarter of the demo's frames, a little smaller: the cloud is right, and complete.

    The cloud is first moved by the similarity that takes the centres of all its cameras nearest to the true ones.
    The true surface is what the keyframes' true depth maps show at their true poses.

    Right: at least 90 % of the points of confidence 0.4 or more have the surface, one point a pixel, within 1 % of
    their distance to the nearest keyframe.

    Complete: at least 85 % of the surface that two keyframes or more see has a point of the cloud within 2.5 cm. The
    surface is sampled once in every 8 x 8 pixels; a keyframe sees a sample if its depth there differs by less than
    1 % from the true depth of the pixel that it falls in.
    """
    write_demo(tmp_path / "demo", width=360, height=270, frames=30)
    prior = prepare(open_capture(tmp_path / "demo"), TrainingOptions(effort="quick"))
    truth = read_ground_truth(tmp_path / "demo")
    assert prior.report is not None
    keyframes = [decision.name for decision in prior.report.decisions if decision.kept]
    positions = true_positions(prior, truth)
    eyes = centres([truth.cameras[name] for name in keyframes])
    allowed = 0.01 * np.linalg.norm(positions[:, None] - eyes, axis=2).min(axis=1)
    assert prior.points is not None
    assert prior.points.confidences is not None
    near = cKDTree(surface(truth, keyframes, 1)).query(positions)[0] < allowed
    right = np.mean(near[prior.points.confidences >= SETTINGS.fusion.confidence])
    samples = surface(truth, keyframes, 8)
    views = np.sum([distances_along_rays(samples, truth, [name]) < 0.01 for name in keyframes], axis=0)
    complete = np.mean(cKDTree(positions).query(samples[views >= 2])[0] < 0.025)
    print(f"right {right:.3f} ({near.mean():.3f} of all), complete {complete:.3f}, {len(positions)} points")
    assert right >= 0.9
    assert complete >= 0.85
    errors = camera_errors(prior.frames, truth)
    print(f"cameras off by {errors.mean():.5f} m on average, at most {errors.max():.5f} m")
    assert errors.mean() < 0.0012
    assert errors.max() < 0.004


def test_what_was_guessed_is_not_reported_as_known(prior: PreparedCapture) -> None:
    report = prior.report
    assert report is not None
    assert report.coverage is not None
    assert report.coverage_known is not None
    assert prior.points is not None
    assert prior.points.confidences is not None
    assert report.guessed == (prior.points.confidences <= GUESSED_CONFIDENCE).sum() > 0
    assert report.coverage_known < report.coverage
