"""A capture as a COLMAP model: read back by our reader, and by COLMAP itself."""

from __future__ import annotations

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
