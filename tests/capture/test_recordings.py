"""The readers on real recordings of phone apps."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from capture.phone_layouts import write_lossless_video
from pocketgs.capture import Frame, open_capture
from pocketgs.capture.frame_parts import reliable_depth
from pocketgs.capture.listing import FrameSource
from pocketgs.capture.loading import Preparation, load_frame
from pocketgs.capture.open import read_listing


@pytest.fixture(scope="module")
def recordings(data_folder: Path) -> Path:
    folder = data_folder / "recordings"
    if not folder.is_dir():
        pytest.skip(f"no recordings of phone apps at {folder}")
    return folder


def disagreement(one: FrameSource, other: FrameSource) -> float:
    """Median relative difference between one frame's depths, transformed to another frame, and that frame's own."""
    depths = [reliable_depth(source) for source in (one, other)]
    cameras = [s.camera.resized(d.shape[1], d.shape[0]) for s, d in zip((one, other), depths, strict=True)]
    rows, columns = np.nonzero(depths[0])
    rays = cameras[0].rays(np.stack([columns, rows], axis=1) + 0.5)
    pixels, depth = cameras[1].project(cameras[0].centre + rays * depths[0][rows, columns, None])
    seen = (depth > 0) & np.all((pixels >= 0) & (pixels < depths[1].shape[::-1]), axis=1)
    columns, rows = pixels[seen].astype(int).T
    there = depths[1][rows, columns]
    assert np.count_nonzero(there) > 1000
    return float(np.median(np.abs(there - depth[seen])[there > 0] / there[there > 0]))


def test_3d_scanner_app(recordings):
    folder = recordings / "scanner_app_lowres"
    listing = read_listing(folder)
    assert (listing.format, listing.metric, listing.warnings) == ("3d-scanner-app", True, ())
    assert [frame.name for frame in listing.frames] == [f"frame_{number:05d}.jpg" for number in range(0, 31, 3)]
    assert {(frame.camera.width, frame.camera.height) for frame in listing.frames} == {(1920, 1440)}
    # Wrong axes of the camera disagree by 5 % and more.
    assert disagreement(listing.frames[0], listing.frames[-1]) < 0.01
    projection = json.loads((folder / "frame_00000.json").read_text())["projectionMatrix"]
    assert listing.frames[0].camera.cx == pytest.approx(960 * (1 - projection[2]), abs=1e-3)
    capture = open_capture(folder, downscale=4)
    assert capture.train[0].image.shape == (360, 480, 3)
    assert 0.4 < np.median(capture.train[0].depth) < 0.7


def test_record3d_export(recordings):
    folder = recordings / "record3d_exr"
    listing = read_listing(folder)
    assert (listing.format, len(listing.frames), listing.metric) == ("record3d", 83, True)
    assert "262 of 345 poses have no image" in listing.warnings[0]
    names = [frame.name for frame in listing.frames]
    assert (names[0], names[-1], "rgb/234.jpg" in names) == ("rgb/225.jpg", "rgb/310.jpg", False)
    camera = listing.frames[0].camera
    assert (camera.width, camera.height) == (1440, 1920)
    assert (camera.fx, camera.cx, camera.cy) == pytest.approx((1404.303, 724.646, 963.784), abs=1e-3)
    depth = reliable_depth(listing.frames[0])
    assert (depth.shape, depth.dtype) == ((256, 192), np.float32)
    assert (depth.min(), depth.max()) == pytest.approx((0.1564, 0.2756), abs=1e-4)
    # Poses go by the numbers of the photographs: by their order they would be off by as many as are missing before.
    poses = json.loads((folder / "metadata.json").read_text())["poses"]
    for index in (0, 20, 82):
        number = int(Path(names[index]).stem)
        np.testing.assert_allclose(listing.frames[index].camera.centre, poses[number][4:], atol=1e-9)


def test_record3d_poses_explain_matches(recordings, tmp_path):
    folder = recordings / "record3d_exr"
    (tmp_path / "rgb").mkdir()
    shutil.copy(folder / "metadata.json", tmp_path)
    for number in (285, 310):
        shutil.copy(folder / f"rgb/{number}.jpg", tmp_path / "rgb")
    one, other = open_capture(tmp_path, downscale=2, hold_out=0).train
    assert np.median(epipolar_distances(one, other)) < 5  # ARKit drifts; the neighbours' poses are off by more


def epipolar_distances(one: Frame, other: Frame) -> np.ndarray:
    """Of SIFT matches, in pixels."""
    detector = cv2.SIFT.create(2000)
    (first, descriptors), (second, others) = (detector.detectAndCompute(f.image, None) for f in (one, other))
    pairs = cv2.BFMatcher().knnMatch(descriptors, others, k=2)
    good = [best for best, next_best in pairs if best.distance < 0.7 * next_best.distance]
    start = np.array([first[match.queryIdx].pt for match in good]) + 0.5
    end = np.array([second[match.trainIdx].pt for match in good]) + 0.5
    assert len(good) > 50
    relative = other.camera.world_to_camera @ one.camera.camera_to_world
    cross = np.cross(np.eye(3), relative[:3, 3]).T
    matrices = [np.linalg.inv(frame.camera.intrinsic_matrix) for frame in (one, other)]
    lines = np.column_stack([start, np.ones(len(start))]) @ (matrices[1].T @ cross @ relative[:3, :3] @ matrices[0]).T
    return np.abs((lines[:, :2] * end).sum(axis=1) + lines[:, 2]) / np.linalg.norm(lines[:, :2], axis=1)


def test_polycam_cameras(recordings, tmp_path):
    cameras = sorted((recordings / "polycam_json").glob("*.json"))
    (tmp_path / "keyframes/images").mkdir(parents=True)
    shutil.copytree(recordings / "polycam_json", tmp_path / "keyframes/cameras")
    for file in cameras:  # the photographs are not part of the sample
        Image.new("RGB", (512, 384)).save(tmp_path / f"keyframes/images/{file.stem}.jpg")
    capture = open_capture(tmp_path, hold_out=0)
    assert (capture.format, len(capture.train), capture.metric) == ("polycam", 2, True)
    camera = capture.train[0].camera
    assert (camera.fx, camera.cx, camera.cy) == pytest.approx((360.47985, 257.5931, 192.1178), abs=1e-4)
    np.testing.assert_allclose(camera.centre, [0.74366665, -0.22433962, 0.63177675], atol=1e-6)


def test_stray_scanner_tables(recordings, tmp_path):
    shutil.copytree(recordings / "stray_csv", tmp_path, dirs_exist_ok=True)
    write_lossless_video(tmp_path / "rgb.mp4", [np.zeros((1440, 1920, 3), np.uint8)] * 8)
    listing = read_listing(tmp_path)  # the video is not part of the sample
    assert [frame.name for frame in listing.frames] == [f"rgb.mp4/{index:06d}" for index in range(8)]
    first, second = (frame.camera for frame in listing.frames[:2])
    assert (first.fx, first.cx, first.cy) == pytest.approx((1597.8881, 955.8694, 718.2071), abs=1e-4)
    assert second.cx == pytest.approx(955.86646, abs=1e-4)
    np.testing.assert_allclose(first.centre, [-0.05574204, 0.019246144, 0.23901562], atol=1e-6)


def test_terrace_names_frames_where_they_are_not(data_folder):
    folder = data_folder / "terrace"
    if not folder.is_dir():
        pytest.skip(f"no capture at {folder}")
    listing = read_listing(folder)
    assert len(listing.frames) == 302
    assert "302 of 302 were found by their names, such as frame_00302.jpg for images/frame_00302.jpg" in " ".join(
        listing.warnings
    )
    frame = load_frame(listing.frames[0], Preparation(lens="ignore"))
    assert frame.image.shape == (270, 480, 3)
    assert frame.camera.fx == pytest.approx(1676.08 / 4, rel=1e-4)


def test_dtu24_masks_go_by_number(data_folder):
    folder = data_folder / "dtu24"
    if not folder.is_dir():
        pytest.skip(f"no capture at {folder}")
    capture = open_capture(folder, downscale=4)
    assert "masked" in capture.protocol
    assert capture.warnings == ()
    for frame in capture.frames:
        assert frame.mask.shape == frame.image.shape[:2]
        assert 0.2 < frame.mask.mean() < 0.9
    # Around the house, the second photograph is overexposed.
    frame = capture.train[0]
    assert frame.image[frame.mask].mean() < 120
    assert frame.image[~frame.mask].mean() > 250
    ignored = open_capture(folder, downscale=4, masks="none")
    assert all(frame.mask is None for frame in ignored.frames)
    assert "masked" not in ignored.protocol
