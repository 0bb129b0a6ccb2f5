"""Paths in transforms JSON files: of Windows, in other folders of images, and in lists of a split."""

from __future__ import annotations

import json
import shutil

import numpy as np
import pytest
from PIL import Image

from pocketgs.capture import open_capture
from pocketgs.capture.open import read_listing
from pocketgs.errors import PocketGSError


@pytest.mark.parametrize("spelt", ["images\\{}", "Images/{}"])
def test_a_split_may_spell_paths_otherwise(ring, write_transforms, spelt):
    lists = {
        "train_filenames": [spelt.format(n) for n in ring.names[:6]],
        "test_filenames": [spelt.format("view_09.png")],
    }
    capture = open_capture(write_transforms(**lists))
    assert ([frame.name for frame in capture.held_out], len(capture.train)) == (["images/view_09.png"], 6)
    assert capture.warnings == ()


def test_a_list_of_a_split_that_names_no_frame_is_told(write_transforms):
    (warning,) = read_listing(write_transforms(test_filenames=["a/1.png", "a/2.png"], val_filenames=[])).warnings
    said = "2 of 2 paths in test_filenames are no file_path of a frame: correct them, the first a/1.png"
    assert warning.endswith(f"transforms.json: {said}")


@pytest.mark.parametrize("part", ["train_filenames", "val_filenames", "test_filenames"])
def test_paths_of_a_split_that_are_no_frames_are_counted(ring, write_transforms, part):
    paths = [f"images/{name}" for name in ring.names]
    lists = {"train_filenames": paths[:6], "test_filenames": paths[8:]}
    lists[part] = [*lists.get(part, paths[6:8]), "a/1.png", "a/2.png"]
    listing = read_listing(write_transforms(**lists))
    count = len(lists[part])
    said = f"2 of {count} paths in {part} are no file_path of a frame: correct them, the first a/1.png"
    assert [warning.partition("json: ")[2] for warning in listing.warnings] == [said]


@pytest.mark.parametrize("linked", [False, True])
def test_absolute_paths_that_are_right(ring, write_transforms, tmp_path_factory, linked):
    """However deep, and of masks too."""
    folder = write_transforms()
    deep = folder / "a/b/c/d/e/f/images"
    for name, pixels in zip(ring.names, ring.images, strict=True):
        (deep / "masks").mkdir(parents=True, exist_ok=True)
        Image.fromarray(pixels).save(deep / name)
        Image.fromarray(pixels[..., 0]).save(deep / "masks" / name)
    frames = ring.transforms(str(deep))["frames"]
    for frame, name in zip(frames, ring.names, strict=True):
        frame["mask_path"] = f"{deep}/masks/{name}"
    write_transforms(frames=frames)
    shutil.rmtree(folder / "images")
    given = folder
    if linked:
        given = tmp_path_factory.mktemp("links") / "link"
        given.symlink_to(folder)
    listing = read_listing(given)
    assert (listing.frames[0].name, listing.warnings) == ("a/b/c/d/e/f/images/view_00.png", ())
    assert all(frame.mask_path for frame in listing.frames)


@pytest.mark.parametrize("separator", ["/", "\\"])
def test_another_folder_of_images_mirrors_folders(ring, write_transforms, separator):
    names = ["a/0.png", "b/0.png"]
    frames = ring.transforms()["frames"][:2]
    for frame, name in zip(frames, names, strict=True):
        frame["file_path"] = f"./images/{name}".replace("/", separator)
    folder = write_transforms(frames=frames)
    for name in names:
        (folder / "images_2" / name).parent.mkdir(parents=True)
        Image.new("RGB", (8, 6)).save(folder / "images_2" / name)
    assert [frame.name for frame in read_listing(folder, "images_2").frames] == [f"images_2/{name}" for name in names]
    (folder / "flat").mkdir()
    for frame, name in zip(frames, ("0.png", "1.png"), strict=True):
        frame["file_path"] = f"images/a/{name}".replace("/", separator)
        Image.new("RGB", (8, 6)).save(folder / "flat" / name)
    flat = read_listing(write_transforms(frames=frames), "flat").frames
    assert [frame.name for frame in flat] == ["flat/0.png", "flat/1.png"]


def test_without_a_size_intrinsics_refer_to_the_stated_image(ring, write_transforms):
    folder = write_transforms(w=None, h=None)
    (folder / "images_2").mkdir()
    for name, image in zip(ring.names, ring.images, strict=True):
        Image.fromarray(image[::2, ::2]).save(folder / "images_2" / name)
    camera = open_capture(folder, images="images_2").train[0].camera
    assert (camera.width, camera.fx, camera.cx) == (8, 10.0, 4.25)
    for name in ring.names:
        (folder / "images" / name).unlink()
    with pytest.raises(
        PocketGSError, match=r"no fields 'w' and 'h', and no image 'images/view_00.png', expected either"
    ):
        read_listing(folder, "images_2")
    (folder / "images").rmdir()
    in_pixels = {"fl_x": None, "fl_y": None, "cx": None, "cy": None, "w": None, "h": None}
    (folder / "transforms.json").write_text(json.dumps({**ring.transforms(), **in_pixels, "camera_angle_x": np.pi / 2}))
    assert read_listing(folder, "images_2").frames[0].camera.fx == pytest.approx(4.0)


def test_blender_scenes_written_on_windows(ring, tmp_path):
    frames = ring.transforms()["frames"][:2]
    for number, frame in enumerate(frames):
        frame["file_path"] = f".\\train\\r_{number}"
    (tmp_path / "transforms_train.json").write_text(json.dumps({"camera_angle_x": 0.7, "frames": frames}))
    with pytest.raises(PocketGSError, match=r"transforms_train\.json: none of the 2 listed frames has an image .*r_0"):
        read_listing(tmp_path)
    (tmp_path / "train").mkdir()
    for number in range(2):
        Image.new("RGB", (16, 12)).save(tmp_path / f"train/r_{number}.png")
    assert [frame.name for frame in read_listing(tmp_path).frames] == ["train/r_0.png", "train/r_1.png"]
