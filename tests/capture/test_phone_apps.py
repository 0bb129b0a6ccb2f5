"""Features common to phone apps' recordings, and Polycam and NeRFCapture."""

from __future__ import annotations

import shutil
from dataclasses import replace

import numpy as np
import pytest

from capture.phone_layouts import (
    WRITERS,
    assert_same_views,
    depth_and_confidence,
    edit_json,
    expected_depth,
    frames_of,
    in_order,
    write_nerfcapture,
    write_polycam,
)
from pocketgs.capture import Capture, open_capture
from pocketgs.capture.open import read_listing
from pocketgs.errors import PocketGSError

BORDERS = {"polycam": 15}


@pytest.mark.parametrize("name", WRITERS)
def test_views_come_back(small_capture, written_phones, name):
    capture = open_capture(written_phones[name])
    assert (capture.format, capture.metric) == (name, True)
    assert_same_views(frames_of(written_phones[name]), in_order(small_capture), BORDERS.get(name, 0))


@pytest.mark.parametrize("name", ["stray-scanner", "polycam", "3d-scanner-app"])
def test_reliable_depths_come_back_in_metres(small_capture, written_phones, name):
    border = BORDERS.get(name, 0)
    for frame, original in zip(frames_of(written_phones[name]), in_order(small_capture), strict=True):
        height, width = original.image.shape[:2]
        expected = expected_depth(original)[border : height - border, border : width - border]
        np.testing.assert_allclose(frame.depth, expected, atol=5.1e-4)
        assert 0 < np.count_nonzero(frame.depth) < frame.depth.size


def test_without_confidence_every_depth_counts(small_capture, copied_phone):
    folder = copied_phone("stray-scanner")
    shutil.rmtree(folder / "confidence")
    for frame, original in zip(frames_of(folder), in_order(small_capture), strict=True):
        np.testing.assert_allclose(frame.depth[1::2, 1::2], depth_and_confidence(original)[0], atol=5.1e-4)


def test_depth_may_be_absent(copied_phone):
    folder = copied_phone("stray-scanner")
    shutil.rmtree(folder / "depth")
    assert all(frame.depth is None for frame in frames_of(folder))


def lengthened(capture: Capture, count: int) -> Capture:
    """The capture with its frames in turn, until there are so many."""
    frames = in_order(capture)
    frames = [replace(frames[index % len(frames)], name=f"{index:04d}.png") for index in range(count)]
    return replace(capture, train=frames, held_out=[])


@pytest.mark.parametrize("name", ["stray-scanner", "record3d"])
def test_long_recordings_are_thinned(small_capture, tmp_path, name):
    WRITERS[name](lengthened(small_capture, 160), tmp_path / name)
    listing = read_listing(tmp_path / name)
    assert len(listing.frames) == 150
    assert "150 of 160 frames are used" in listing.warnings[-1]


@pytest.mark.parametrize("name", ["stray-scanner", "record3d", "polycam", "3d-scanner-app"])
def test_an_image_folder_is_of_no_use(written_phones, name):
    with pytest.raises(PocketGSError, match="images='photos' given"):
        open_capture(written_phones[name], images="photos")


def test_an_apps_own_data_goes_before_what_was_converted_from_it(written_phones, copied_phone):
    folder = copied_phone("polycam")
    shutil.copytree(written_phones["nerfstudio"], folder, dirs_exist_ok=True)
    assert read_listing(folder).format == "polycam"
    assert read_listing(folder / "transforms.json").format == "nerfstudio"


# Polycam


def test_uncorrected_keyframes_are_the_fallback(small_capture, tmp_path):
    write_polycam(small_capture, tmp_path, kind="")
    assert "ARKit's poses are used" in read_listing(tmp_path).warnings[0]
    assert_same_views(frames_of(tmp_path), in_order(small_capture))
    write_polycam(small_capture, tmp_path)
    assert read_listing(tmp_path).warnings == ()
    assert "corrected_images" in read_listing(tmp_path).frames[0].name


@pytest.mark.parametrize("suffix", [".JPG", ".jpeg"])
def test_keyframes_of_another_suffix(copied_phone, suffix):
    folder = copied_phone("polycam")
    names = [frame.name for frame in read_listing(folder).frames]
    for image in sorted((folder / "keyframes/corrected_images").iterdir()):
        image.rename(image.with_suffix(suffix))
    assert [frame.name for frame in read_listing(folder).frames] == [f"{name[:-4]}{suffix}" for name in names]


def test_keyframes_without_an_image(copied_phone):
    folder = copied_phone("polycam")
    images = sorted((folder / "keyframes/corrected_images").iterdir())
    images[3].unlink()
    (folder / "keyframes/corrected_cameras/._1000000.json").write_bytes(b"\0\5\x16\7")
    listing = read_listing(folder)
    assert len(listing.frames) == 7
    assert "1 of 8 cameras have no image" in listing.warnings[0]
    shutil.rmtree(folder / "keyframes/corrected_images")
    with pytest.raises(PocketGSError, match="keyframes"):
        read_listing(folder)


@pytest.mark.parametrize(
    ("replaced", "message"),
    [
        ({"t_12": None}, "field 't_12' is None, expected a finite number"),
        ({"t_12": float("nan")}, "field 't_12' is nan, expected a finite number"),
        ({"t_00": 5}, "the pose is not rigid"),
        ({"fx": 0}, "focal lengths 0"),
        ({"width": "wide"}, "field 'width'"),
        ({"width": 200}, "expected the shape of its camera"),
    ],
)
def test_broken_cameras(copied_phone, replaced, message):
    folder = copied_phone("polycam")
    camera = sorted((folder / "keyframes/corrected_cameras").iterdir())[0]
    edit_json(camera, **replaced)
    with pytest.raises(PocketGSError, match=message):
        open_capture(folder)


def test_damaged_cameras_are_left_out(copied_phone):
    """Unless most are."""
    folder = copied_phone("polycam")
    cameras = sorted((folder / "keyframes/corrected_cameras").iterdir())
    cameras[2].write_bytes(b"")
    listing = read_listing(folder)
    assert len(listing.frames) == 7
    [warning] = listing.warnings
    assert "1 of 8 cameras are damaged, the first (" in warning
    assert f"{cameras[2].name}: not valid JSON" in warning
    for camera in cameras[4:]:
        camera.write_text("{")
    with pytest.raises(PocketGSError, match="not valid JSON"):
        read_listing(folder)


# 3D Scanner App


@pytest.mark.parametrize(
    ("replaced", "message"),
    [
        ({"cameraPoseARFrame": [1.0] * 12}, "field 'cameraPoseARFrame'"),
        ({"intrinsics": [0.0] * 9}, "image size 0x0"),
        ({"projectionMatrix": [0.0] * 16}, "not a perspective projection"),
        ({"projectionMatrix": [2.0] * 16}, "expected the shape of its camera"),
    ],
)
def test_broken_poses_of_3d_scanner_app(copied_phone, replaced, message):
    folder = copied_phone("3d-scanner-app")
    edit_json(folder / "frame_00003.json", **replaced)
    with pytest.raises(PocketGSError, match=message):
        open_capture(folder)


def test_3d_scanner_app_without_photographs(copied_phone):
    folder = copied_phone("3d-scanner-app")
    for photograph in folder.glob("*.jpg"):
        photograph.unlink()
    with pytest.raises(PocketGSError, match="none of its 24 poses has a photograph"):
        read_listing(folder)


# NeRFCapture


def test_offline_depth_is_left_out(written_phones):
    capture = open_capture(written_phones["nerfstudio"])
    assert "its depth maps are left out" in capture.warnings[0]
    assert all(frame.depth is None for frame in capture.frames)


def test_depth_with_a_scale(small_capture, tmp_path):
    write_nerfcapture(small_capture, tmp_path, depth_range=10.0)
    capture = open_capture(tmp_path, hold_out=0)
    assert (capture.metric, capture.warnings) == (False, ())
    for frame, original in zip(capture.train, in_order(small_capture), strict=True):
        np.testing.assert_allclose(frame.depth, original.depth, atol=10 / 65535)
