"""What is kept of COLMAP's models: focal lengths and features in the photographs' pixels."""

from __future__ import annotations

import numpy as np
import pycolmap
import pytest

from pocketgs.structure_from_motion.colmap.mapping_job import MappingJob
from pocketgs.structure_from_motion.colmap.verify_and_map import _enlarge, _with_stated_focal_lengths


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> pycolmap.Reconstruction:
    """The true model of cameras around points, whose features are half a pixel off."""
    options = pycolmap.SyntheticDatasetOptions()
    options.num_rigs, options.num_frames_per_rig, options.num_points3D = 1, 8, 200
    pycolmap.set_random_seed(0)
    with pycolmap.Database.open(tmp_path_factory.mktemp("scene") / "features.db") as database:
        found = pycolmap.synthesize_dataset(options, database)
    generator = np.random.default_rng(0)
    for image in found.images.values():
        for point in image.points2D:
            point.xy = point.xy + generator.normal(scale=0.4, size=2)
    found.update_point_3d_errors()
    return found


def job(model: pycolmap.Reconstruction, focal_length: float, times: int = 1) -> MappingJob:
    """With a focal length that EXIF states, and photographs `times` as large as the copies with the features."""
    (camera,) = model.cameras.values()
    size = [camera.width, camera.height]
    stated = {"focal_length": focal_length, "focal_length_is_known": True}
    full_size = [times * side for side in size]
    return {"cameras": [{**stated, "size": size, "full_size": full_size}]}  # type: ignore[typeddict-item,list-item]


@pytest.mark.parametrize("ratio", [0.7, 1.05, 1.4])
def test_a_focal_length_that_fits_worse_is_not_taken_from_exif(model: pycolmap.Reconstruction, ratio: float) -> None:
    """As of photographs that were cropped, whose EXIF data are those of the whole."""
    focal = next(iter(model.cameras.values())).mean_focal_length()
    found = _with_stated_focal_lengths(job(model, ratio * focal), pycolmap.Reconstruction(model))
    assert next(iter(found.cameras.values())).mean_focal_length() == focal


def test_features_are_enlarged_with_the_photographs(model: pycolmap.Reconstruction) -> None:
    """Other programs read them from the model, and errors are in pixels of the photographs."""
    larger, (before,) = pycolmap.Reconstruction(model), model.cameras.values()
    _enlarge(job(model, 1.0, times=3), larger)
    (camera,) = larger.cameras.values()
    assert (camera.width, camera.height) == (3 * before.width, 3 * before.height)
    assert larger.compute_mean_reprojection_error() == pytest.approx(3 * model.compute_mean_reprojection_error())
    for number, image in larger.images.items():
        before_enlarging = np.array([point.xy for point in model.images[number].points2D])
        np.testing.assert_allclose([point.xy for point in image.points2D], 3 * before_enlarging)
