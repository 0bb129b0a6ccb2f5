"""The reader of Record3D's captures."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from capture.phone_layouts import depth_and_confidence, edit_json, expected_depth, frames_of, in_order, zip_folder
from pocketgs.capture import open_capture
from pocketgs.capture.formats.lzfse import lzfse_is_installed, read_compressed, unpacked_size
from pocketgs.capture.open import read_listing
from pocketgs.errors import PocketGSError
from pocketgs.files.memory_bound import memory_bound


def test_an_archive_reads_as_its_content(written_phones, tmp_path):
    archive = zip_folder(written_phones["record3d"], tmp_path / "walk.r3d")
    capture = open_capture(archive, hold_out_every=0)
    assert capture.format == "record3d"
    for frame, unpacked in zip(capture.train, frames_of(written_phones["record3d"]), strict=True):
        np.testing.assert_array_equal(frame.image, unpacked.image)
        np.testing.assert_array_equal(frame.camera.world_to_camera, unpacked.camera.world_to_camera)
    assert [path.name for path in tmp_path.iterdir()] == ["walk.r3d"]


def test_intrinsics_of_each_frame_prevail(copied_phone):
    folder = copied_phone("record3d")
    table = [[80.0 + index, 90.0, 40.0, 30.0] for index in range(8)]
    edit_json(folder / "metadata", perFrameIntrinsicCoeffs=table)
    cameras = [frame.camera for frame in read_listing(folder).frames]
    assert [[camera.fx, camera.fy, camera.cx, camera.cy] for camera in cameras] == table
    edit_json(folder / "metadata", perFrameIntrinsicCoeffs=table[:5])
    with pytest.raises(PocketGSError, match="'perFrameIntrinsicCoeffs' has 5 rows, expected 8"):
        read_listing(folder)


@pytest.mark.parametrize(
    ("replaced", "message"),
    [
        ({"poses": None}, "field 'poses'"),
        ({"poses": []}, "field 'poses'"),
        ({"poses": [[0, 0, 0, 1, 0, 0]]}, "field 'poses'"),
        ({"poses": [[0, 0, 0, 1, 0, float("nan"), 0]]}, "field 'poses'"),
        ({"poses": [[0, 0, 0, 0, 0, 0, 0]]}, "frame 0: rotation quaternion"),
        ({"poses": [[0, 0, 0, 1, 0, 0, 0]] * 8}, "all 8 poses are the same; recordings of the selfie camera have none"),
        ({"K": [1, 2, 3]}, "field 'K'"),
        ({"K": [0] * 9}, "focal lengths 0, 0"),
        ({"w": None}, "field 'w'"),
        ({"w": 720}, "image of 96x72 pixels, expected the shape of its camera, 720x72"),
    ],
)
def test_broken_metadata(copied_phone, replaced, message):
    folder = copied_phone("record3d")
    edit_json(folder / "metadata", **replaced)
    with pytest.raises(PocketGSError, match=message):
        open_capture(folder, hold_out_every=0)


def test_images_and_poses_that_do_not_match(copied_phone):
    folder = copied_phone("record3d")
    edit_json(folder / "metadata", poses=json.loads((folder / "metadata").read_text())["poses"][:6])
    listing = read_listing(folder)
    assert len(listing.frames) == 6
    assert "lists 6 poses, the images beyond them are left out" in listing.warnings[0]
    for index in (0, 2):
        (folder / f"rgbd/{index}.jpg").unlink()
    assert "2 of 6 poses have no image" in read_listing(folder).warnings[0]
    for path in (folder / "rgbd").iterdir():
        path.unlink()
    with pytest.raises(PocketGSError, match="none of its 6 poses has an image"):
        read_listing(folder)


@pytest.mark.parametrize("keep", [0, 100, 0.5, 0.99])
def test_truncated_archives(written_phones, tmp_path, keep):
    archive = zip_folder(written_phones["record3d"], tmp_path / "walk.r3d")
    whole = archive.read_bytes()
    archive.write_bytes(whole[: int(keep if keep > 1 else keep * len(whole))])
    with pytest.raises(PocketGSError, match=r"walk\.r3d: not a readable \.r3d archive"):
        open_capture(archive)


def test_damaged_members_of_archives(written_phones, tmp_path):
    archive = zip_folder(written_phones["record3d"], tmp_path / "walk.r3d")
    whole = archive.read_bytes()
    archive.write_bytes(whole.replace(b'"poses"', b'"roses"', 1))
    with pytest.raises(PocketGSError, match=r"walk\.r3d.metadata: cannot be read"):
        open_capture(archive)
    middle = whole.index(b"rgbd/3.jpg") + 500
    archive.write_bytes(whole[:middle] + bytes(50) + whole[middle + 50 :])
    with pytest.raises(PocketGSError, match=r"walk\.r3d.rgbd.3\.jpg: cannot be decoded"):
        open_capture(archive)


def test_without_the_package_depth_is_left_out(copied_phone):
    if lzfse_is_installed():
        pytest.skip("pyliblzfse is installed")
    folder = copied_phone("record3d")
    (folder / "rgbd/0.depth").write_bytes(b"bvx2")
    capture = open_capture(folder)
    assert capture.warnings == (f"{folder}: its depth maps are left out, reading them needs the package pyliblzfse",)
    assert all(frame.depth is None for frame in capture.frames)


@pytest.mark.parametrize("packed", [False, True])
def test_compressed_depths_come_back(small_capture, copied_phone, tmp_path, packed):
    liblzfse = pytest.importorskip("liblzfse")
    folder = copied_phone("record3d")
    originals = in_order(small_capture)
    for index, frame in enumerate(originals):
        depth, confidence = depth_and_confidence(frame)
        (folder / f"rgbd/{index}.depth").write_bytes(liblzfse.compress(depth.astype("<f4").tobytes()))
        (folder / f"rgbd/{index}.conf").write_bytes(liblzfse.compress(confidence.tobytes()))
    path = zip_folder(folder, tmp_path / "walk.r3d") if packed else folder
    for frame, original in zip(frames_of(path), originals, strict=True):
        np.testing.assert_allclose(frame.depth, expected_depth(original), rtol=1e-6)
    if not packed:
        (folder / "rgbd/5.depth").write_bytes(liblzfse.compress(bytes(12)))
        with pytest.raises(PocketGSError, match=r"5\.depth: holds 12 bytes, expected 6912 for 48x36 pixels"):
            open_capture(path)


@pytest.mark.parametrize("raw", [bytes(3_000_000), bytes(range(256)) * 40, b"short"])
def test_what_lzfse_unpacks_to_is_known_before(raw: bytes) -> None:
    liblzfse = pytest.importorskip("liblzfse")
    assert unpacked_size(liblzfse.compress(raw)) == len(raw)


def test_a_bomb_of_lzfse_is_refused(tmp_path: Path) -> None:
    liblzfse = pytest.importorskip("liblzfse")
    path = tmp_path / "bomb.depth"
    path.write_bytes(liblzfse.compress(bytes(50_000_000)))
    assert path.stat().st_size < 100_000
    with memory_bound(60), pytest.raises(PocketGSError, match="unpacking 50,000,000 bytes would take"):
        read_compressed(path)
    for damaged in (b"bvx2", path.read_bytes()[:2000], b"bvx?" + bytes(40)):
        path.write_bytes(damaged)
        with pytest.raises(PocketGSError, match="cannot be decompressed"):
            read_compressed(path)
