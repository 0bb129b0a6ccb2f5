"""A capture as a COLMAP model: read back by our reader, and by COLMAP itself."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pocketgs.capture import Capture, open_capture
from pocketgs.capture.colmap_export import export_capture
from pocketgs.errors import PocketGSError


@pytest.fixture
def exported(tmp_path: Path, small_capture: Capture) -> Path:
    export_capture(tmp_path / "model", small_capture)
    return tmp_path / "model"


def test_reads_back(exported: Path, small_capture: Capture) -> None:
    found = open_capture(exported, hold_out=8)
    assert found.format == "colmap"
    assert found.warnings == ()
    originals = sorted(small_capture.frames, key=lambda frame: frame.name)
    frames = sorted(found.frames, key=lambda frame: frame.name)
    assert len(frames) == len(originals)
    for frame, original in zip(frames, originals, strict=True):
        assert Path(frame.name).stem.endswith(Path(original.name).stem)
        assert np.array_equal(frame.image, original.image)
        one, other = frame.camera, original.camera
        assert (one.width, one.height, one.fx, one.fy, one.cx, one.cy) == (
            *(other.width, other.height),
            *(other.fx, other.fy, other.cx, other.cy),
        )
        np.testing.assert_allclose(one.world_to_camera, other.world_to_camera, atol=1e-12)
    assert found.points is not None
    assert small_capture.points is not None
    assert np.array_equal(found.points.positions, small_capture.points.positions)
    np.testing.assert_allclose(found.points.colours, small_capture.points.colours, atol=0.5 / 255 + 1e-6)


def split_of(capture: Capture, left_out: set[int], every: int = 8) -> Capture:
    """Views with every n-th held out, without some of them."""
    frames = [replace(capture.train[0], name=f"{number:02d}.png") for number in range(20)]
    kept = [(at, frame) for at, frame in enumerate(frames) if at not in left_out]
    train, held_out = ([frame for at, frame in kept if (at % every == 0) == held] for held in (False, True))
    return replace(capture, train=train, held_out=held_out)


@pytest.mark.parametrize(
    ("left_out", "warning"),
    [
        (set(), None),
        ({1, 9, 17}, None),
        ({1, 2, 3, 4}, "3 views are held out, more than every 8th of 16 images: hold out all from 15_16.png on"),
        ({0, 8, 16}, "0 views are held out, fewer than every 8th of 17 images: hold out none from 00_01.png on"),
        ({8, 16}, "1 view is held out, fewer than every 8th of 18 images: hold out none from 08_09.png on"),
    ],
)
def test_every_eighth_by_name_is_held_out_where_views_are_missing(
    tmp_path: Path, small_capture: Capture, left_out: set[int], warning: str | None
) -> None:
    warnings: list[str] = []
    capture = split_of(small_capture, left_out)
    export_capture(tmp_path / "model", capture, on_warning=warnings.append)
    assert warnings == ([warning] if warning else [])
    found = open_capture(tmp_path / "model")
    assert len(found.frames) == len(capture.frames)
    if not warning:
        assert [frame.name[-6:] for frame in found.held_out] == [frame.name for frame in capture.held_out]


def test_every_third_is_held_out_if_the_split_is_that(tmp_path: Path, small_capture: Capture) -> None:
    capture = split_of(small_capture, {4}, every=3)
    export_capture(tmp_path / "model", capture, every=3)
    held_out = open_capture(tmp_path / "model", hold_out=3).held_out
    assert [frame.name[-6:] for frame in held_out] == [frame.name for frame in capture.held_out]


def test_colmap_reads_it(exported: Path, small_capture: Capture) -> None:
    pycolmap = pytest.importorskip("pycolmap")
    model = pycolmap.Reconstruction(exported / "sparse" / "0")
    originals = sorted(small_capture.frames, key=lambda frame: frame.name)
    assert model.num_reg_images() == len(originals)
    assert model.num_points3D() == len(small_capture.points)
    images = sorted(model.images.values(), key=lambda image: image.name)
    for image, original in zip(images, originals, strict=True):
        assert (exported / "images" / image.name).is_file()
        camera = model.cameras[image.camera_id]
        np.testing.assert_allclose(camera.calibration_matrix(), original.camera.intrinsic_matrix)
        np.testing.assert_allclose(
            image.cam_from_world().matrix(), original.camera.world_to_camera[:3], rtol=1e-9, atol=1e-9
        )


def test_folder_that_holds_something(tmp_path: Path, small_capture: Capture) -> None:
    (tmp_path / "model").mkdir()
    (tmp_path / "model" / "photo.jpg").write_bytes(b"precious")
    for path in (tmp_path / "model", tmp_path / "model" / "photo.jpg"):
        with pytest.raises(PocketGSError, match="expected a new or empty folder"):
            export_capture(path, small_capture)
    assert [path.name for path in (tmp_path / "model").iterdir()] == ["photo.jpg"]


def test_empty_folder_and_folders_above_it(tmp_path: Path, small_capture: Capture) -> None:
    (tmp_path / "empty").mkdir()
    for path in (tmp_path / "empty", tmp_path / "a" / "b"):
        export_capture(path, small_capture)
        assert sorted(each.name for each in path.iterdir()) == ["images", "sparse"]
    assert not [each for each in tmp_path.iterdir() if each.name.startswith(".")]
