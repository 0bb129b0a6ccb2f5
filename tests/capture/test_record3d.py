"""The reader of Record3D's captures."""

from __future__ import annotations

import json
import shutil
import struct
import zipfile
from pathlib import Path

import lzfse
import numpy as np
import pytest

from capture.phone_layouts import edit_json, expected_depth, frames_of, in_order, zip_folder
from pocketgs.capture import open_capture
from pocketgs.capture.decoding.lzfse import most_unpacked, read_compressed
from pocketgs.capture.open import read_listing
from pocketgs.errors import PocketGSError
from pocketgs.files.memory_bound import memory_bound


def test_an_archive_reads_as_its_content(written_phones, tmp_path):
    archive = zip_folder(written_phones["record3d"], tmp_path / "walk.r3d")
    capture = open_capture(archive, hold_out=0)
    assert capture.format == "record3d"
    for frame, unpacked in zip(capture.train, frames_of(written_phones["record3d"]), strict=True):
        np.testing.assert_array_equal(frame.image, unpacked.image)
        np.testing.assert_array_equal(frame.camera.world_to_camera, unpacked.camera.world_to_camera)
    assert [path.name for path in tmp_path.iterdir()] == ["walk.r3d"]


def test_an_archive_whose_names_begin_with_its_folder(written_phones, tmp_path):
    """As bsdtar packs them."""
    packed = zip_folder(written_phones["record3d"], tmp_path / "walk.r3d")
    with zipfile.ZipFile(packed) as plain, zipfile.ZipFile(tmp_path / "again.r3d", "w") as again:
        again.writestr("./", b"")
        for name in plain.namelist():
            again.writestr(f"./{name}", plain.read(name))
    expected, found = (open_capture(path, hold_out=0).train for path in (packed, tmp_path / "again.r3d"))
    for frame, other in zip(expected, found, strict=True):
        np.testing.assert_array_equal(frame.image, other.image)
        np.testing.assert_array_equal(frame.depth, other.depth)


def test_a_folder_stands_for_the_only_archive_in_it(written_phones, tmp_path):
    archive = zip_folder(written_phones["record3d"], tmp_path / "walk.r3d")
    (tmp_path / "._walk.r3d").write_bytes(b"\0\5\x16\7")
    capture = open_capture(tmp_path)
    assert (capture.name, capture.format) == (tmp_path.name, "record3d")
    assert "using the one in it, walk.r3d" in capture.warnings[0]
    shutil.copy(archive, tmp_path / "run.r3d")
    with pytest.raises(PocketGSError, match=r"holds 2 captures, run\.r3d, walk\.r3d: name one of them"):
        open_capture(tmp_path)


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
        open_capture(folder, hold_out=0)


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
    [warning] = open_capture(archive).warnings
    assert "1 of 8 photographs cannot be decoded, the first rgbd/3.jpg" in warning
    assert f"{archive}/rgbd/3.jpg: cannot be decoded" in warning


@pytest.mark.parametrize("packed", [False, True])
def test_compressed_depths_come_back(small_capture, written_phones, tmp_path, packed):
    folder = written_phones["record3d"]
    path = zip_folder(folder, tmp_path / "walk.r3d") if packed else folder
    for frame, original in zip(frames_of(path), in_order(small_capture), strict=True):
        np.testing.assert_allclose(frame.depth, expected_depth(original), rtol=1e-6)


def test_depths_of_another_size(copied_phone):
    folder = copied_phone("record3d")
    (folder / "rgbd/5.depth").write_bytes(lzfse.compress(bytes(12)))
    capture = open_capture(folder)
    assert "5.depth: holds 12 bytes, expected 6912 for 48x36 pixels" in capture.warnings[0]
    assert [frame.name for frame in capture.frames if frame.depth is None] == ["rgbd/5.jpg"]


@pytest.mark.parametrize("missing", ["dw", "dh"])
def test_depths_without_a_stated_size_are_left_out(copied_phone, missing):
    folder = copied_phone("record3d")
    edit_json(folder / "metadata", **{missing: None})
    listing = read_listing(folder)
    assert "depth maps are left out, no fields 'dh' and 'dw' state their size" in listing.warnings[-1]
    assert all(frame.depth_path is None and frame.confidence_path is None for frame in listing.frames)


@pytest.mark.parametrize(
    "raw",
    [bytes(3_000_000), bytes(range(256)) * 40, b"word " * 200, b"short"],
    ids=["zeros", "lzfse", "lzvn", "stored"],
)
def test_the_bound_of_what_lzfse_unpacks_to(raw: bytes) -> None:
    packed = lzfse.compress(raw)
    assert len(raw) <= most_unpacked(packed) <= len(raw) + 40_000 + 136 * len(packed)


def test_a_bomb_of_lzfse_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "bomb.depth"
    honest = lzfse.compress(bytes(50_000_000))
    assert len(honest) < 100_000
    modest = honest[:4] + struct.pack("<I", 12) + honest[8:]  # states that its first block unpacks to 12 bytes
    for bomb in (honest, modest):
        path.write_bytes(bomb)
        with memory_bound(60), pytest.raises(PocketGSError, match=r"unpacking up to 5\d,\d{3},\d{3} bytes would take"):
            read_compressed(path)


@pytest.mark.parametrize(
    "damaged",
    [b"", b"bvx2", b"bvx2" + bytes(40), b"bvx?" + bytes(40), lzfse.compress(bytes(range(256)) * 40)[:300]],
    ids=["empty", "no header", "header of no bytes", "unknown", "truncated"],
)
def test_damaged_lzfse(tmp_path: Path, damaged: bytes) -> None:
    path = tmp_path / "0.depth"
    path.write_bytes(damaged)
    with pytest.raises(PocketGSError, match=r"0\.depth: cannot be decompressed with LZFSE"):
        read_compressed(path)
