"""The reader of Stray Scanner's captures."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from capture.phone_layouts import assert_same_views, frames_of, in_order, save, with_quarter_turn
from pocketgs.capture import open_capture
from pocketgs.capture.loading import Preparation, load_frame
from pocketgs.capture.open import read_listing
from pocketgs.errors import PocketGSError


def test_frames_of_a_video_are_read_as_the_sensor_took_them(small_capture, copied_phone):
    folder = copied_phone("stray-scanner")
    turned = with_quarter_turn((folder / "rgb.mp4").read_bytes(), small_capture.train[0].camera.height)
    (folder / "rgb.mp4").write_bytes(turned)
    assert_same_views(frames_of(folder), in_order(small_capture))


def test_a_frame_of_a_video_may_be_loaded_alone(small_capture, written_phones):
    source = read_listing(written_phones["stray-scanner"]).frames[5]
    assert str(source.image).endswith("rgb.mp4, frame 5")
    assert_same_views([load_frame(source, Preparation())], [in_order(small_capture)[5]])


def edit_lines(path: Path, change: Callable[[list[str]], list[str]]) -> None:
    path.write_text("\n".join(change(path.read_text().splitlines())) + "\n")


def test_frames_without_a_pose_are_left_out(small_capture, copied_phone):
    folder = copied_phone("stray-scanner")
    edit_lines(folder / "odometry.csv", lambda lines: [*lines[:3], *lines[5:], lines[-1].replace("000007", "000009")])
    assert read_listing(folder).warnings == (
        f"{folder}: rgb.mp4 has 8 frames and odometry.csv 7 poses, the 6 that match are used",
    )
    expected = in_order(small_capture)
    assert_same_views(frames_of(folder), expected[:2] + expected[4:])


def test_further_columns_and_another_order_of_lines(small_capture, copied_phone):
    folder = copied_phone("stray-scanner")
    edit_lines(folder / "odometry.csv", lambda lines: [f"{line}, 1" for line in [lines[0], *lines[:0:-1]]])
    assert_same_views(frames_of(folder), in_order(small_capture))


def test_intrinsics_of_each_frame_prevail(copied_phone):
    folder = copied_phone("stray-scanner")
    given = read_listing(folder).frames[0].camera
    edit_lines(
        folder / "odometry.csv",
        lambda lines: [
            f"{lines[0]}, fx, fy, cx, cy, distortion_center_x, distortion_center_y",
            *(f"{line}, {90 + number}, 91, 47, 35, , " for number, line in enumerate(lines[1:8])),
            f"{lines[8]}, , , , , , ",
        ],
    )
    cameras = [frame.camera for frame in read_listing(folder).frames]
    assert [camera.fx for camera in cameras[:7]] == [90 + number for number in range(7)]
    assert (cameras[0].fy, cameras[0].cx, cameras[0].cy) == (91, 47.5, 35.5)
    np.testing.assert_array_equal(cameras[7].intrinsic_matrix, given.intrinsic_matrix)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda lines: [], r"odometry\.csv: its first line is not a header"),
        (lambda lines: lines[1:], r"odometry\.csv: its first line is not a header"),
        (lambda lines: lines[:1], r"odometry\.csv: no pose belongs to one of the 8 frames"),
        (lambda lines: [*lines[:-1], lines[-1][:40]], r"odometry\.csv, line 9: holds \d values, expected 9"),
        (lambda lines: [*lines, lines[-1]], r"odometry\.csv, line 10: a second pose of frame 7"),
        (lambda lines: [*lines, "1, 000008, nan, 0, 0, 0, 0, 0, 1"], r"line 10: the pose holds NaN"),
        (lambda lines: [*lines, "1, 000008, 0, 0, 0, 0, nan, 0, 1"], r"line 10: rotation quaternion"),
        (lambda lines: [*lines, "1, 000008, 0, 0, 0, 0, 0, 0, 0"], r"line 10: rotation quaternion"),
        (lambda lines: [*lines, "1, -1, 0, 0, 0, 0, 0, 0, 1"], r"line 10: frame -1"),
        (lambda lines: [*lines, "1, eight, 0, 0, 0, 0, 0, 0, 1"], r"line 10: not a number"),
        (lambda lines: [lines[0], lines[1].replace("000000", "999999")], r"odometry\.csv: no pose belongs"),
    ],
)
def test_broken_odometry(copied_phone, change, message):
    folder = copied_phone("stray-scanner")
    edit_lines(folder / "odometry.csv", change)
    with pytest.raises(PocketGSError, match=message):
        open_capture(folder)


@pytest.mark.parametrize(
    "content", ["", "1, 2, 3", "1, 0, 3\n0, 1\n0, 0, 1", "a, b, c", "nan,0,1\n0,1,1\n0,0,1", "\xff"]
)
def test_broken_camera_matrix(copied_phone, content):
    folder = copied_phone("stray-scanner")
    (folder / "camera_matrix.csv").write_bytes(content.encode("latin-1"))
    with pytest.raises(PocketGSError, match=r"camera_matrix\.csv"):
        open_capture(folder)


def test_missing_truncated_and_foreign_videos(copied_phone, tmp_path):
    folder = copied_phone("stray-scanner")
    video = folder / "rgb.mp4"
    whole = video.read_bytes()
    video.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(PocketGSError, match=r"rgb\.mp4"):
        open_capture(folder)
    video.unlink()
    with pytest.raises(PocketGSError, match=r"no rgb\.mp4"):
        open_capture(folder)
    (tmp_path / "elsewhere.mp4").write_bytes(whole)
    video.symlink_to(tmp_path / "elsewhere.mp4")
    with pytest.raises(PocketGSError, match="outside the capture's folder"):
        open_capture(folder)


def test_broken_depth_maps_are_left_out_and_named(copied_phone):
    folder = copied_phone("stray-scanner")
    depth, confidence = folder / "depth/000003.png", folder / "confidence/000003.png"
    save(np.zeros((5, 4), np.uint8), confidence)
    said = "depth maps of 1 frames cannot be used, the first of rgb.mp4/000003: they are left out"
    (warning,) = open_capture(folder).warnings
    assert f"{said} ({confidence}: 4x5 pixels, expected the depth map's 48x36)" in warning
    depth.write_bytes(depth.read_bytes()[:100])
    capture = open_capture(folder)
    assert f"{said} ({depth}: cannot be decoded" in capture.warnings[0]
    assert [frame.name for frame in capture.frames if frame.depth is None] == ["rgb.mp4/000003"]


@settings(max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    table=st.sampled_from(["odometry.csv", "camera_matrix.csv"]), start=st.integers(0, 800), junk=st.binary(max_size=9)
)
def test_damaged_tables_never_crash(written_phones, copied_once, table, start, junk):
    whole = (written_phones["stray-scanner"] / table).read_bytes()
    start %= len(whole)
    (copied_once / table).write_bytes(whole[:start] + junk + whole[start + len(junk) :])
    with contextlib.suppress(PocketGSError):
        assert read_listing(copied_once).frames
    (copied_once / table).write_bytes(whole)


@pytest.fixture
def copied_once(copied_phone: Callable[[str], Path]) -> Path:
    return copied_phone("stray-scanner")
