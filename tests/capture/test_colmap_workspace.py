"""COLMAP workspaces with several models: disconnected ones, and those of undistorted images."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

from pocketgs.capture.open import read_listing
from pocketgs.errors import PocketGSError

RADIAL = "3 SIMPLE_RADIAL 16 12 20 8 6 -0.08\n"


def write_model(folder, colmap_files, count=10, cameras=None):
    """The first `count` of the ring's images as a text model, with other cameras if given."""
    colmap_files.write(folder, "text")
    lines = colmap_files.text["images"].splitlines(keepends=True)
    (folder / "images.txt").write_text("".join(lines[: 1 + 2 * count]))
    if cameras:
        (folder / "cameras.txt").write_text(cameras)


@pytest.mark.parametrize("undistorted", ["dense", "dense/0"])
@pytest.mark.parametrize("root", ["", "/data/me/photos/", "C:\\me\\photos\\"])
def test_undistorted_images_are_not_undistorted_again(ring, colmap_files, tmp_path, undistorted, root):
    """COLMAP's automatic reconstructor leaves the originals where they are, and its first model is of these."""
    write_model(tmp_path / "sparse/0", colmap_files, cameras=RADIAL)
    write_model(tmp_path / undistorted / "sparse", colmap_files)
    for model in ("sparse/0", f"{undistorted}/sparse"):
        images = tmp_path / model / "images.txt"
        images.write_text(images.read_text().replace("view_", f"{root}view_"))
    ring.write_images(tmp_path / undistorted / "images")
    listing = read_listing(tmp_path)
    assert listing.frames[0].name == f"{undistorted}/images/view_00.png"
    assert not any(frame.lens.distorts for frame in listing.frames)
    ring.write_images(tmp_path / "images")  # the originals, which the first model is of
    listing = read_listing(tmp_path)
    assert (listing.frames[0].name, listing.frames[0].lens.distorts) == ("images/view_00.png", True)
    if not root:
        assert not read_listing(tmp_path, f"{undistorted}/images").frames[0].lens.distorts


def test_images_of_another_model_are_not_found_by_name(ring, colmap_files, tmp_path):
    write_model(tmp_path / "sparse/0", colmap_files, cameras=RADIAL)
    write_model(tmp_path / "flat/sparse", colmap_files)
    ring.write_images(tmp_path / "flat/images")
    with pytest.raises(PocketGSError, match="holds none of the 10 registered images"):
        read_listing(tmp_path)
    ring.write_images(tmp_path / "originals")
    assert read_listing(tmp_path).frames[0].name == "originals/view_00.png"


def test_the_largest_of_several_models_is_taken(ring, colmap_files, tmp_path):
    ring.write_images(tmp_path / "images")
    for name, count in (("2", 3), ("10", 7), ("notes", 10)):
        write_model(tmp_path / "sparse" / name, colmap_files, count)
    listing = read_listing(tmp_path)
    assert len(listing.frames) == 7
    assert listing.warnings == (
        "2 COLMAP models that do not fit together: sparse/2 with 3, sparse/10 with 7 images; only the largest, "
        "sparse/10 with 7, is used",
    )


def test_images_without_a_pose_are_counted_where_they_are_the_most(ring, colmap_files, tmp_path):
    ring.write_images(tmp_path / "images")
    write_model(tmp_path / "sparse/0", colmap_files, 5)
    assert read_listing(tmp_path).warnings == ()
    Image.fromarray(np.zeros((12, 16, 3), np.uint8)).save(tmp_path / "images/more.png")
    [warning] = read_listing(tmp_path).warnings
    assert warning == "only 5 of 11 images have a pose in the COLMAP model: let pocketgs pose find all anew"
    (tmp_path / "posed.json").write_text("{}")  # of pocketgs pose, which has told
    assert read_listing(tmp_path).warnings == ()
