"""Poses that are wrong as a whole: read in another convention, or unrelated to the photographs."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pocketgs.capture import Capture
from pocketgs.capture.synthetic import true_capture
from pocketgs.errors import PocketGSError
from pocketgs.geometry.camera import Camera, look_at
from pocketgs.prior.poses.convention import Agreement, MisreadPosesError, check_adjusted
from pocketgs.prior.poses.structure import StructureSettings
from pocketgs.prior.prior import PriorSettings, build_prior

SPARSE = PriorSettings(dense=False, structure=StructureSettings(features=1000))
OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])
UPRIGHT = np.array([[0.0, -1.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])


@pytest.fixture(scope="module")
def sparse_points(clean_walk: Capture) -> int:
    """With the right poses."""
    report = build_prior(clean_walk, 1000, SPARSE).report
    assert report
    assert not report.poses.convention
    return report.sparse_points


def misread(capture: Capture, mistake: Callable[[np.ndarray], np.ndarray]) -> Capture:
    """The capture with a mistake in all of its poses."""
    poses = {frame.name: mistake(frame.camera.world_to_camera) for frame in capture.frames}
    cameras = {frame.name: replace(frame.camera, world_to_camera=poses[frame.name]) for frame in capture.frames}
    return capture.with_refined_poses(cameras)


def relative_poses(capture: Capture) -> np.ndarray:
    """(F - 1, 4, 4) poses relative to the first frame's, which do not depend on the world."""
    first, *others = [frame.camera for frame in capture.frames]
    return np.array([camera.world_to_camera @ first.camera_to_world for camera in others])


@pytest.mark.parametrize(
    ("mistake", "said"),
    [
        (lambda pose: OPENGL @ pose, "OpenGL's camera axes in place of OpenCV's, or the reverse"),
        (np.linalg.inv, "inverted transforms"),
        (lambda pose: np.linalg.inv(OPENGL @ pose), "or the reverse and inverted transforms"),
        (lambda pose: UPRIGHT @ pose, "camera axes (y, -x, z) in place of (x, y, z)"),
    ],
)
def test_another_convention_is_found(
    clean_walk: Capture, sparse_points: int, mistake: Callable[[np.ndarray], np.ndarray], said: str
) -> None:
    found = build_prior(misread(clean_walk, mistake), 1000, SPARSE)
    assert found.report
    assert found.report.poses_refined
    assert any(said in warning for warning in found.report.warnings)
    assert len(found.frames) == len(clean_walk.frames)
    assert np.abs(relative_poses(found) - relative_poses(clean_walk)).max() < 0.05
    assert found.report.sparse_points > 0.8 * sparse_points


def test_poses_that_must_stay_are_refused(clean_walk: Capture) -> None:
    settings = replace(SPARSE, structure=replace(SPARSE.structure, bundle=False))
    with pytest.raises(MisreadPosesError, match=r"fit the poses only with OpenGL's camera axes.*: correct"):
        build_prior(misread(clean_walk, lambda pose: OPENGL @ pose), 1000, settings)


def test_poses_of_something_else_are_refused(clean_walk: Capture) -> None:
    rng = np.random.default_rng(0)

    def anything(pose: np.ndarray) -> np.ndarray:
        other = np.eye(4)
        other[:3, :3], other[:3, 3] = Rotation.random(random_state=rng).as_matrix(), rng.normal(size=3)
        return other

    with pytest.raises(PocketGSError, match=r"\d\d% of [\d,]+ matches contradict the capture's poses"):
        build_prior(misread(clean_walk, anything), 1000, SPARSE)


def test_poses_of_another_walk_are_refused_where_adjusting_them_does_not_help() -> None:
    capture = true_capture(width=240, height=180, frames=16, points=1)
    angles = np.linspace(0.0, 2 * np.pi, len(capture.frames), endpoint=False)
    cameras = {}
    for frame, angle in zip(capture.frames, angles, strict=True):
        elsewhere = frame.camera.camera_to_world.copy()
        elsewhere[:3, 3] += 0.25 * np.array([np.cos(angle), np.sin(angle), np.sin(2 * angle)])
        cameras[frame.name] = replace(frame.camera, world_to_camera=np.linalg.inv(elsewhere))
    with pytest.raises(PocketGSError, match=r"7\d% of \d\d,\d+ matches contradict the capture's poses"):
        build_prior(capture.with_refined_poses(cameras), 1000, SPARSE)


@pytest.mark.parametrize(("share", "is_right", "passes"), [(0.3, True, True), (0.3, False, False), (0.6, False, True)])
def test_what_most_matches_contradicted_has_to_fit(share: float, is_right: bool, passes: bool) -> None:
    rng = np.random.default_rng(0)
    points = rng.uniform(-1.0, 1.0, (600, 3))
    eyes = [np.array([x, 0.0, -4.0]) for x in (-0.5, 0.5)]
    poses = [look_at(eye, np.zeros(3), np.array([0.0, -1.0, 0.0])) for eye in eyes]
    cameras = [Camera(640, 480, 500.0, 500.0, 320.0, 240.0, pose) for pose in poses]
    positions = [camera.project(points)[0] for camera in cameras]
    if not is_right:
        positions[1] = positions[1][::-1]
    matches = {(0, 1): np.stack([np.arange(600)] * 2, axis=1)}
    with nullcontext() if passes else pytest.raises(PocketGSError, match="70% of 700 matches contradict"):
        check_adjusted(Agreement(share, 700), cameras, positions, matches)
