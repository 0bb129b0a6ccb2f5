"""Captures far from their origin are moved to one of their own, and results can be moved back."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pocketgs import Capture, open_capture
from pocketgs.capture.colmap_export import export_capture
from pocketgs.capture.origin import FAR, middle_if_far, with_origin
from pocketgs.results.cameras_file import read_cameras, with_poses_of, write_cameras

ELSEWHERE = (456_789.25, -5_412_345.5, 312.125)


@pytest.fixture
def far(capture_folder: Path) -> Path:
    """The same capture, moved to where a country's grid might have it, without its cloud: .ply has too few digits."""
    path = capture_folder / "transforms.json"
    document = json.loads(path.read_text())
    del document["ply_file_path"]
    for frame in document["frames"]:
        for row, offset in zip(frame["transform_matrix"], ELSEWHERE, strict=False):
            row[3] += offset
    path.write_text(json.dumps(document))
    return capture_folder


def test_a_capture_far_away_is_held_near_an_origin_that_it_names(far: Path, small_capture: Capture) -> None:
    found = open_capture(far)
    assert np.abs(np.subtract(found.origin, ELSEWHERE)).max() < 5
    assert found.origin == tuple(round(value, 1) for value in found.origin)
    assert f"{found.origin[0]:.12g}" in found.warnings[-1]
    for frame in found.frames:
        [given_one] = [other for other in small_capture.frames if frame.name.endswith(other.name)]
        expected = given_one.camera.centre + np.subtract(ELSEWHERE, found.origin)
        np.testing.assert_allclose(frame.camera.centre, expected, atol=1e-7)
        assert np.abs(frame.camera.centre).max() < 10


def test_others_stay_where_they_are(capture_folder: Path) -> None:
    found = open_capture(capture_folder)
    assert (found.origin, found.warnings) == ((0.0, 0.0, 0.0), ())


def test_cameras_at_one_point_stay_where_they_are(far: Path) -> None:
    path = far / "transforms.json"
    document = json.loads(path.read_text())
    for frame in document["frames"]:
        for row, centre in zip(frame["transform_matrix"], (3.1, -0.7, 1.3), strict=False):
            row[3] = centre
    path.write_text(json.dumps(document))
    assert open_capture(far).warnings == ()


@settings(max_examples=50)
@given(st.floats(1e-4, 1e6), st.floats(0, 1e9), st.integers(0, 100))
def test_what_is_left_is_small(extent: float, distance: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    centres = extent * rng.uniform(-1, 1, (6, 3)) + distance * rng.uniform(-1, 1, 3)
    origin = middle_if_far(centres, metric=False)
    left = np.abs(np.median(centres - (0.0 if origin is None else np.array(origin)), axis=0)).max()
    assert left <= 2 * FAR * extent
    if origin is not None:
        assert left <= 2 * extent


@pytest.mark.parametrize("metric", [True, False])
def test_a_lost_pose_at_zero_does_not_hide_that_the_others_are_far(metric: bool) -> None:
    centres = np.array([5e5, 5.4e6, 120]) + np.random.default_rng(0).uniform(-1, 1, (40, 3))
    centres[7] = 0
    origin = middle_if_far(centres, metric)
    assert origin is not None
    assert np.abs(np.median(centres, axis=0) - origin).max() <= 1


def test_metres_are_not_far_within_a_kilometre() -> None:
    """Cameras with little motion do not cause a move."""
    centres = np.array([[30.0, 2.0, 500.0], [30.001, 2.0, 500.0]])
    assert middle_if_far(centres, metric=True) is None
    assert middle_if_far(centres, metric=False) is not None


def test_a_result_is_shown_about_its_own_origin(far: Path, tmp_path: Path) -> None:
    """Also one that was made before the capture was moved."""
    capture = open_capture(far)
    path = tmp_path / "cameras.json"
    for origin in (capture.origin, (0.0, 0.0, 0.0)):
        result = with_origin(capture, origin)
        write_cameras(path, result.frames, refined=True, origin=origin)
        assert read_cameras(path).origin == origin
        found = with_poses_of(capture, path)
        assert found.origin == origin
        for frame, expected in zip(found.frames, result.frames, strict=True):
            np.testing.assert_array_equal(frame.camera.world_to_camera, expected.camera.world_to_camera)


def test_exported_cameras_are_the_captures_own(far: Path, small_capture: Capture, tmp_path: Path) -> None:
    assert small_capture.points is not None
    capture = open_capture(far)
    near = small_capture.points.positions + np.subtract(ELSEWHERE, capture.origin)
    export_capture(tmp_path / "colmap", replace(capture, points=replace(small_capture.points, positions=near)))
    found = open_capture(tmp_path / "colmap")
    assert found.origin == capture.origin
    centres = [frame.camera.centre for frame in sorted(found.frames, key=lambda frame: frame.name)]
    expected = [frame.camera.centre for frame in sorted(capture.frames, key=lambda frame: frame.name)]
    np.testing.assert_allclose(centres, expected, atol=1e-6)
    assert found.points is not None
    np.testing.assert_allclose(found.points.positions, near, atol=1e-6)
