"""Photographs as they were taken: cameras with lenses from reading to the run's files."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pocketgs.capture import list_capture, open_capture
from pocketgs.capture.colmap_export import export_capture
from pocketgs.capture.pinhole_copy import frames_at, has_lenses, without_lenses
from pocketgs.errors import PocketGSError
from pocketgs.geometry.camera import look_at
from pocketgs.prior.prior import build_prior
from pocketgs.results.cameras_file import read_cameras, write_cameras

COEFFICIENTS = (-0.1, 0.02, 0.001, -0.002)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Nine photographs in nerfstudio's format, through a lens that bends."""
    rng = np.random.default_rng(0)
    frames = []
    for number in range(9):
        name = f"images/{number}.png"
        (tmp_path / "images").mkdir(exist_ok=True)
        Image.fromarray(rng.integers(0, 256, (48, 64, 3)).astype(np.uint8)).save(tmp_path / name)
        pose = look_at(np.array([0.2 * number, 0.0, -4.0]), np.zeros(3), np.array([0.0, -1.0, 0.0]))
        camera_to_world = np.linalg.inv(pose) @ np.diag([1.0, -1.0, -1.0, 1.0])
        frames.append({"file_path": name, "transform_matrix": camera_to_world.tolist()})
    lens = dict(zip(("k1", "k2", "p1", "p2"), COEFFICIENTS, strict=True))
    size = {"w": 64, "h": 48, "fl_x": 60.0, "fl_y": 60.0, "cx": 32.0, "cy": 24.0}
    document = {"camera_model": "OPENCV", **size, **lens, "frames": frames}
    (tmp_path / "transforms.json").write_text(json.dumps(document), encoding="utf-8")
    return tmp_path


def test_photographs_stay_as_they_are(folder: Path) -> None:
    capture = open_capture(folder, lens="direct")
    assert has_lenses(capture)
    assert capture.protocol == "as photographed (lens in the renderer), 64x48, held out every 8th by name"
    frame = next(frame for frame in capture.frames if frame.name.endswith("3.png"))
    np.testing.assert_array_equal(frame.image, np.asarray(Image.open(folder / "images/3.png")))
    assert frame.camera.lens.padded[:4] == COEFFICIENTS
    small = open_capture(folder, lens="direct", downscale=2)
    assert small.frames[0].camera.lens == frame.camera.lens
    assert small.frames[0].camera.width == 32


def test_copies_for_the_prior_are_those_of_undistorting(folder: Path) -> None:
    direct, expected = open_capture(folder, lens="direct"), open_capture(folder)
    copy = without_lenses(direct)
    assert not has_lenses(copy)
    for one, other in zip(copy.frames, expected.frames, strict=True):
        np.testing.assert_array_equal(one.image, other.image)
        assert one.camera.intrinsic_matrix.tolist() == other.camera.intrinsic_matrix.tolist()
    assert direct.photographs is not None
    assert all(direct.photographs.map(lambda frame: frame.camera.is_pinhole, 100).values())
    back = frames_at(direct.train, copy.train[1:])
    assert [frame.name for frame in back] == [frame.name for frame in direct.train[1:]]
    assert back[0].camera.lens == direct.train[0].camera.lens


@pytest.mark.parametrize("shrink", [1, 2, 3])
def test_outlines_know_the_copies_for_the_prior(folder: Path, shrink: int) -> None:
    listed = list_capture(folder, lens="direct")
    outline, copy = listed.outline(shrink), without_lenses(listed.load(shrink))
    assert outline.copies is not None
    for stated, frames in ((outline.copies.training, copy.train), (outline.copies.held_out, copy.held_out)):
        sizes = [(frame.camera.width, frame.camera.height) for frame in frames]
        assert np.abs(np.subtract(stated, sizes)).max() <= 2
    assert (outline.lenses, outline.copies.lenses) == (0, 1)
    assert list_capture(folder).outline().copies is None


def test_there_are_three_ways_with_a_lens(folder: Path) -> None:
    with pytest.raises(PocketGSError, match="lens 'fish', expected undistort, direct, ignore"):
        open_capture(folder, lens="fish")  # type: ignore[arg-type]


def test_lenses_are_kept_in_files(folder: Path, tmp_path: Path) -> None:
    capture = open_capture(folder, lens="direct")
    write_cameras(tmp_path / "cameras.json", capture.frames, refined=False)
    saved = read_cameras(tmp_path / "cameras.json").cameras
    assert all(saved[frame.name].lens == frame.camera.lens for frame in capture.frames)
    export_capture(tmp_path / "colmap", capture)
    exported = open_capture(tmp_path / "colmap", lens="direct")
    assert all(frame.camera.lens.padded[:4] == COEFFICIENTS for frame in exported.frames)


def test_the_prior_takes_pinhole_cameras_only(folder: Path) -> None:
    with pytest.raises(PocketGSError, match="found cameras with lenses"):
        build_prior(open_capture(folder, lens="direct"), 100)
