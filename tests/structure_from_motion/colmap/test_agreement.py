"""Models that join parts of a scene wrongly, of a synthetic scene."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pycolmap
import pytest
from scipy.spatial.transform import Rotation

from pocketgs.structure_from_motion.colmap import agreement, mapping
from pocketgs.structure_from_motion.colmap.agreement import forget, split
from pocketgs.structure_from_motion.colmap.mapping import agreeing_models
from pocketgs.structure_from_motion.colmap.mapping_job import MappingJob

IMAGES = 12
APART = [3, 4, 5, 6]


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> tuple[pycolmap.Reconstruction, Path]:
    """The true model of cameras around points, and a database with all their matches."""
    path = tmp_path_factory.mktemp("scene") / "features.db"
    options = pycolmap.SyntheticDatasetOptions()
    options.num_rigs, options.num_frames_per_rig, options.num_points3D = 1, IMAGES, 300
    options.camera_has_prior_focal_length = True
    pycolmap.set_random_seed(0)
    with pycolmap.Database.open(path) as database:
        model = pycolmap.synthesize_dataset(options, database)
    return model, path


def wrongly_joined(model: pycolmap.Reconstruction, numbers: Sequence[int]) -> pycolmap.Reconstruction:
    """The model with some images moved as one."""
    moved = pycolmap.Reconstruction(model)
    motion = pycolmap.Rigid3d(
        pycolmap.Rotation3d(Rotation.from_rotvec([0.2, 0.5, 0.3]).as_quat()), np.array([0.5, -0.3, 0.4])
    )
    for number in numbers:
        frame = moved.frame(moved.images[number].frame_id)
        frame.rig_from_world = frame.rig_from_world * motion
    return moved


def placed(model: pycolmap.Reconstruction) -> list[int]:
    return sorted(number for number, image in model.images.items() if image.has_pose)


def test_a_right_model_stays_whole(scene: tuple[pycolmap.Reconstruction, Path]) -> None:
    model = pycolmap.Reconstruction(scene[0])
    with pycolmap.Database.open(scene[1]) as database:
        assert split(model, database, True) == ([], [])
    assert len(placed(model)) == IMAGES
    assert model.num_points3D() == scene[0].num_points3D()


def test_images_that_contradict_the_others_lose_their_poses(scene: tuple[pycolmap.Reconstruction, Path]) -> None:
    model = wrongly_joined(scene[0], APART)
    with pycolmap.Database.open(scene[1]) as database:
        found = split(model, database, True)
    assert found.parts == [len(APART)]
    assert placed(model) == [number for number in placed(scene[0]) if number not in APART]


@pytest.mark.parametrize(("fit", "parts"), [(0.75, []), (0.65, []), (0.55, [len(APART)])])
def test_poses_that_are_only_imprecise_do_not_contradict_each_other(
    scene: tuple[pycolmap.Reconstruction, Path], monkeypatch: pytest.MonkeyPatch, fit: float, parts: list[int]
) -> None:
    """As between the halves of a walk straight ahead; by chance, up to half of the matches fit."""
    model = pycolmap.Reconstruction(scene[0])
    is_apart = np.isin(sorted(model.images), APART)
    fits = np.where(is_apart[:, None] == is_apart, 0.95, fit)
    monkeypatch.setattr(agreement, "_matches", lambda *_: (np.full_like(fits, 50.0), fits))
    with pycolmap.Database.open(scene[1]) as database:
        assert split(model, database, True).parts == parts


@pytest.mark.parametrize("refine_lenses", [True, False])
def test_lenses_stay_as_stated_if_asked(scene: tuple[pycolmap.Reconstruction, Path], refine_lenses: bool) -> None:
    model = wrongly_joined(scene[0], APART)
    camera = next(iter(model.cameras.values()))
    camera.params = [1300.0, *camera.params[1:]]
    with pycolmap.Database.open(scene[1]) as database:
        split(model, database, refine_lenses)
    assert (next(iter(model.cameras.values())).params[0] == 1300.0) != refine_lenses


def test_a_part_that_joined_is_no_other_model(
    scene: tuple[pycolmap.Reconstruction, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    truth, database = scene
    part = pycolmap.Reconstruction(truth)
    for number in placed(truth):
        if number not in APART:
            part.deregister_frame(part.images[number].frame_id)
    monkeypatch.setitem(mapping.MAPPERS, "incremental", lambda *_: [wrongly_joined(truth, APART), part])
    assert len(agreeing_models(job(truth), database)) == 1


def test_they_are_placed_anew(
    scene: tuple[pycolmap.Reconstruction, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    truth, database = scene
    monkeypatch.setitem(mapping.MAPPERS, "incremental", lambda *_: [wrongly_joined(truth, APART)])
    (found, rest), *others = agreeing_models(job(truth), database)
    assert (placed(found), rest, others) == (placed(truth), [], [])
    for number in placed(truth):
        for other in placed(truth):
            turn = relative(found, number, other).rotation * relative(truth, number, other).rotation.inverse()
            assert turn.angle() < 1e-3


def test_images_of_which_none_agree_are_no_model(
    scene: tuple[pycolmap.Reconstruction, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nor is a model without images."""
    truth, database = scene
    scattered, empty = truth, pycolmap.Reconstruction(truth)
    for number in placed(truth)[1:]:
        scattered = wrongly_joined(scattered, range(number, IMAGES + 1))
    for number in placed(truth):
        empty.deregister_frame(empty.images[number].frame_id)
    monkeypatch.setitem(mapping.MAPPERS, "incremental", lambda *_: [scattered, empty])
    assert agreeing_models(job(truth), database) == []


def test_matches_that_joined_parts_are_forgotten(scene: tuple[pycolmap.Reconstruction, Path], tmp_path: Path) -> None:
    """Both before and after verification, whose counts must stay equal."""
    copy = shutil.copy(scene[1], tmp_path)
    first, second = placed(scene[0])[:2]
    with pycolmap.Database.open(copy) as database:
        count = database.num_verified_image_pairs()
        forget([(first, second)], database)
        assert database.num_verified_image_pairs() == database.num_matched_image_pairs() == count - 1
        assert not database.exists_matches(first, second)


def relative(model: pycolmap.Reconstruction, first: int, second: int) -> pycolmap.Rigid3d:
    return model.images[second].cam_from_world() * model.images[first].cam_from_world().inverse()


def job(model: pycolmap.Reconstruction) -> MappingJob:
    """What the mapper asks about; the database is filled."""
    images = [{"name": image.name, "features": ""} for image in model.images.values()]
    return {  # type: ignore[typeddict-item]
        "cameras": [{"images": images}],
        "least_matches": 15,
        "mapper": "incremental",
        "refine_lenses": True,
        "go_on": False,
        "better_than": 0,
        "seed": 0,
    }


def test_a_smaller_model_does_not_replace_the_largest(
    scene: tuple[pycolmap.Reconstruction, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without the matches that joined parts, COLMAP may place fewer images than before."""
    truth, database = scene[0], Path(shutil.copy(scene[1], tmp_path))
    fewer = pycolmap.Reconstruction(truth)
    for number in placed(truth)[5:]:
        fewer.deregister_frame(fewer.images[number].frame_id)
    monkeypatch.setitem(mapping.MAPPERS, "incremental", lambda *_: [wrongly_joined(truth, APART)])
    monkeypatch.setattr(mapping, "_go_on_from", lambda *_: [fewer])
    (found, rest), *_ = agreeing_models(job(truth), database)
    assert (len(placed(found)), rest) == (IMAGES - len(APART), [len(APART)])


def test_a_lens_that_makes_no_sense_is_no_model(
    scene: tuple[pycolmap.Reconstruction, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Placing all images at once lets focal lengths along both axes drift apart where nothing determines them."""
    models = {}
    for number, stretch in enumerate((1.0, 1.05, 1.3)):
        models[number] = pycolmap.Reconstruction(scene[0])
        camera = next(iter(models[number].cameras.values()))
        focal, across, down = camera.mean_focal_length(), camera.principal_point_x, camera.principal_point_y
        camera.model = pycolmap.CameraModelId.PINHOLE
        camera.params = [focal, stretch * focal, across, down]
    monkeypatch.setattr(pycolmap, "global_mapping", lambda *_: models)
    assert mapping.MAPPERS["global"](job(scene[0]), scene[1]) == [models[0], models[1]]
