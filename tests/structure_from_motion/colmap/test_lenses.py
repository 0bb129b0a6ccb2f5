"""Lenses of COLMAP's models: simple while images are placed, then as requested where many images determine them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pycolmap
import pytest

from pocketgs.structure_from_motion.colmap.bundle_adjustment import adjust_bundle
from pocketgs.structure_from_motion.colmap.lenses import MANY_IMAGES, simple_lens, with_requested_lenses
from pocketgs.structure_from_motion.colmap.mapping_job import MappingJob

LENS = [1280.0, 1280.0, 512.0, 384.0, -0.1, 0.06, 0.004, -0.003]


def mapped(folder: Path, images: int) -> pycolmap.Reconstruction:
    """The best model with a simple lens of photographs that were taken through LENS."""
    options = pycolmap.SyntheticDatasetOptions()
    options.num_rigs, options.num_frames_per_rig, options.num_points3D = 1, images, 300
    options.camera_model_id, options.camera_params = pycolmap.CameraModelId.OPENCV, LENS
    pycolmap.set_random_seed(0)
    with pycolmap.Database.open(folder / "features.db") as database:
        model = pycolmap.synthesize_dataset(options, database)
    (camera,) = model.cameras.values()
    camera.model = pycolmap.CameraModelId.SIMPLE_RADIAL
    camera.params = [1280.0, 512.0, 384.0, 0.0]
    adjust_bundle(model)
    model.update_point_3d_errors()
    return model


def job(model: str, refine_lenses: bool = True) -> MappingJob:
    return {"cameras": [{"model": model}], "refine_lenses": refine_lenses}  # type: ignore[typeddict-item,list-item]


@pytest.fixture(scope="module")
def simple(tmp_path_factory: pytest.TempPathFactory) -> pycolmap.Reconstruction:
    return mapped(tmp_path_factory.mktemp("scene"), MANY_IMAGES)


def test_many_images_determine_the_lens(simple: pycolmap.Reconstruction) -> None:
    found = with_requested_lenses(job("OPENCV"), simple)
    (camera,) = found.cameras.values()
    np.testing.assert_allclose(camera.params, LENS, rtol=1e-3, atol=1e-4)
    assert simple.compute_mean_reprojection_error() > 0.1
    assert found.compute_mean_reprojection_error() < 0.01


@pytest.mark.parametrize("requested", ["RADIAL", "PINHOLE"])
def test_other_lenses(simple: pycolmap.Reconstruction, requested: str) -> None:
    """A pinhole camera has no distortion to start from, but another focal length for y."""
    found = pycolmap.Reconstruction(simple)
    (camera,) = found.cameras.values()
    if requested == "PINHOLE":
        camera.model, camera.params = pycolmap.CameraModelId.SIMPLE_PINHOLE, camera.params[:3]
        adjust_bundle(found)
        found.update_point_3d_errors()
    enriched = with_requested_lenses(job(requested), found)
    (camera,) = enriched.cameras.values()
    assert camera.model_name == requested
    assert enriched.compute_mean_reprojection_error() < 1.1 * found.compute_mean_reprojection_error()


def test_a_simple_lens_stays_what_it_is(simple: pycolmap.Reconstruction, tmp_path: Path) -> None:
    """If few images, or a motion that determines no lens, would have to tell more; or if it was requested."""
    assert with_requested_lenses(job("SIMPLE_RADIAL"), simple) is simple
    assert with_requested_lenses(job("OPENCV", refine_lenses=False), simple) is simple
    few = mapped(tmp_path, MANY_IMAGES - 1)
    assert with_requested_lenses(job("OPENCV"), few) is few


def test_a_lens_that_makes_no_sense_is_not_taken(
    simple: pycolmap.Reconstruction, monkeypatch: pytest.MonkeyPatch
) -> None:
    def diverge(model: pycolmap.Reconstruction) -> None:
        adjust_bundle(model)
        (camera,) = model.cameras.values()
        model.update_point_3d_errors()
        camera.focal_length_y = 2 * camera.focal_length_x

    monkeypatch.setattr("pocketgs.structure_from_motion.colmap.lenses.adjust_bundle", diverge)
    monkeypatch.setattr(pycolmap.Reconstruction, "update_point_3d_errors", lambda self: None)
    assert with_requested_lenses(job("OPENCV"), simple) is simple


def test_lenses_that_images_are_placed_with() -> None:
    assert [simple_lens(name) for name in ("OPENCV", "PINHOLE", "OPENCV_FISHEYE", "SIMPLE_RADIAL")] == [
        "SIMPLE_RADIAL",
        "SIMPLE_PINHOLE",
        "OPENCV_FISHEYE",
        "SIMPLE_RADIAL",
    ]
