"""The LLFF reader."""

from __future__ import annotations

import contextlib
import io
import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image

from pocketgs.capture import open_capture
from pocketgs.capture.open import read_listing
from pocketgs.errors import PocketGSError


@pytest.fixture
def llff_folder(ring, colmap_files, tmp_path: Path) -> Path:
    """The ring as an LLFF capture, with COLMAP's cloud but not its images."""
    np.save(tmp_path / "poses_bounds.npy", ring.poses_bounds())
    ring.write_images(tmp_path / "images")
    colmap_files.write(tmp_path / "sparse/0")
    (tmp_path / "sparse/0/images.bin").unlink()
    return tmp_path


def test_reads_poses_and_cloud(ring, llff_folder):
    capture = open_capture(llff_folder)
    assert capture.format == "llff"
    frames = sorted(capture.frames, key=lambda frame: frame.name)
    for frame, camera in zip(frames, ring.cameras, strict=True):
        np.testing.assert_allclose(frame.camera.world_to_camera, camera.world_to_camera, atol=1e-9)
        assert (frame.camera.fx, frame.camera.cx, frame.camera.cy) == (20, 8, 6)
    np.testing.assert_allclose(capture.points.positions, ring.positions, rtol=1e-6)


def test_intrinsics_follow_the_size_of_the_images(ring, llff_folder):
    (llff_folder / "images_4").mkdir()
    for name, image in zip(ring.names, ring.images, strict=True):
        Image.fromarray(image[::4, ::4]).save(llff_folder / "images_4" / name)
    camera = open_capture(llff_folder, images="images_4").train[0].camera
    assert (camera.width, camera.height, camera.fx, camera.cx) == (4, 3, 5, 2)


def test_largest_folder_present_is_taken(ring, llff_folder):
    (llff_folder / "images").rename(llff_folder / "images_2")
    assert open_capture(llff_folder).train[0].name.startswith("images_2/")
    (llff_folder / "images_2").rename(llff_folder / "photos")
    with pytest.raises(PocketGSError, match="images_8"):
        open_capture(llff_folder)


def test_the_lens_is_that_of_the_only_camera(llff_folder):
    radial = struct.pack("<QiiQQ4d", 1, 3, 2, 16, 12, 20.0, 8.0, 6.0, 0.05)
    (llff_folder / "sparse/0/cameras.bin").write_bytes(radial)
    assert read_listing(llff_folder).frames[0].lens.coefficients[0] == 0.05
    two = struct.pack("<Q", 2) + radial[8:] + struct.pack("<i", 4) + radial[12:]
    (llff_folder / "sparse/0/cameras.bin").write_bytes(two)
    assert not read_listing(llff_folder).frames[0].lens.distorts


@pytest.mark.parametrize(
    "change",
    [
        lambda table: table[:9],
        lambda table: table[:0],
        lambda table: table[:, :15],
        lambda table: table[0],
        lambda table: np.where(table == table[0, 0], np.nan, table),
        lambda table: table * 2,
        lambda table: table.astype(str),
        lambda table: np.array([{"pickled": 1}], dtype=object),
    ],
)
def test_wrong_arrays(ring, llff_folder, change):
    np.save(llff_folder / "poses_bounds.npy", change(ring.poses_bounds()), allow_pickle=True)
    with pytest.raises(PocketGSError, match=r"poses_bounds\.npy"):
        open_capture(llff_folder)


def test_a_header_that_states_a_huge_array(llff_folder):
    buffer = io.BytesIO()
    header = {"descr": "<f8", "fortran_order": False, "shape": (10**12, 17)}
    np.lib.format.write_array_header_1_0(buffer, header)
    (llff_folder / "poses_bounds.npy").write_bytes(buffer.getvalue() + bytes(100))
    with pytest.raises(PocketGSError, match=r"poses_bounds\.npy"):
        open_capture(llff_folder)


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(position=st.integers(0, 10_000), replacement=st.binary(max_size=40), cut=st.integers(0, 2000))
def test_damaged_arrays_never_crash(ring, llff_folder, position, replacement, cut):
    buffer = io.BytesIO()
    np.save(buffer, ring.poses_bounds())
    whole = buffer.getvalue()
    position %= len(whole)
    damaged = whole[:position] + replacement + whole[position + len(replacement) :]
    (llff_folder / "poses_bounds.npy").write_bytes(damaged[: len(damaged) - cut])
    with contextlib.suppress(PocketGSError):
        assert read_listing(llff_folder).frames
