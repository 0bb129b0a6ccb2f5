"""The page reads COLMAP's models as Python does, also from workspaces with several of them."""

from __future__ import annotations

import shutil
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from PIL import Image
from playwright.sync_api import Error

from capture.conftest import ColmapFiles, Ring
from static_site.reading import assert_same, assert_same_refusal, assert_same_warnings, read

Call = Callable[..., Any]


@pytest.mark.parametrize("encoding", ["binary", "text"])
@pytest.mark.parametrize("place", ["sparse/0", "colmap/sparse"])
def test_colmap(call: Call, ring: Ring, colmap_files: ColmapFiles, tmp_path: Path, encoding: str, place: str) -> None:
    ring.write_images(tmp_path / "images")
    colmap_files.write(tmp_path / place, encoding)
    assert_same(call, tmp_path)


def test_undistorted_images_go_with_their_model(
    call: Call, ring: Ring, colmap_files: ColmapFiles, tmp_path: Path
) -> None:
    for folder in ("images", "dense/images"):
        ring.write_images(tmp_path / folder)
    colmap_files.write(tmp_path / "dense/sparse")
    assert_same(call, tmp_path)


@pytest.mark.parametrize(
    "line",
    [
        "3 SIMPLE_PINHOLE 16 12 20 8 6",
        "3 SIMPLE_RADIAL 16 12 20 8 6 0.1",
        "3 OPENCV 16 12 20 21 8 6 0.1 0.2 0.3 0.4",
        "3 FULL_OPENCV 16 12 20 21 8 6 .1 .2 .3 .4 .5 .6 .7 .8",
        "3 RADIAL_FISHEYE 16 12 20 8 6 0.1 0.2",
    ],
)
def test_colmap_cameras(call: Call, ring: Ring, colmap_files: ColmapFiles, tmp_path: Path, line: str) -> None:
    ring.write_images(tmp_path / "images_8")
    colmap_files.write(tmp_path / "sparse" / "0", "text")
    (tmp_path / "sparse" / "0" / "cameras.txt").write_text(line + "\n")
    (tmp_path / "images_8" / ring.names[3]).unlink()
    assert_same(call, tmp_path)


@pytest.mark.parametrize("before", ["", "2024 0"])
def test_images_without_lines_of_points(
    call: Call, ring: Ring, colmap_files: ColmapFiles, tmp_path: Path, before: str
) -> None:
    ring.write_images(tmp_path / "images")
    for path in [*(tmp_path / "images").iterdir()]:
        path.rename(path.with_name(f"{before}{path.name}"))
    colmap_files.write(tmp_path / "sparse/0", "text")
    lines = [line for line in colmap_files.text["images"].splitlines() if line.endswith(".png")]
    text = "\n".join(lines).replace("view_", f"{before}view_")
    (tmp_path / "sparse/0/images.txt").write_text(text, encoding="utf-8-sig")
    assert_same(call, tmp_path)


@pytest.mark.parametrize("encoding", ["binary", "text"])
def test_a_camera_of_another_model_that_took_no_image(
    call: Call, ring: Ring, colmap_files: ColmapFiles, tmp_path: Path, encoding: str
) -> None:
    ring.write_images(tmp_path / "images")
    colmap_files.write(tmp_path, encoding)
    text, binary = tmp_path / "cameras.txt", tmp_path / "cameras.bin"
    if encoding == "text":
        text.write_text("9 FOV 16 12 20 20 8 6 0.1\n" + text.read_text())
    else:
        fov = struct.pack("<iiQQ5d", 9, 7, 16, 12, 20, 20, 8, 6, 0.1)
        binary.write_bytes(struct.pack("<Q", 2) + fov + binary.read_bytes()[8:])
    assert_same(call, tmp_path)


@pytest.mark.parametrize("name", ["image{number:03d}.png", "{back}_{number}.png", "{letter}.png"])
@pytest.mark.parametrize("folder", ["images", "images_4"])
def test_renamed_copies(
    call: Call, ring: Ring, colmap_files: ColmapFiles, tmp_path: Path, folder: str, name: str
) -> None:
    """The numbers in their names count, whatever the order of these, or else the order."""
    colmap_files.write(tmp_path / "sparse" / "0")
    (tmp_path / folder).mkdir()
    for number, image in enumerate(ring.images):
        copy = name.format(number=number, letter="abcdefghij"[number], back="jihgfedcba"[number])
        Image.fromarray(image).save(tmp_path / folder / copy)
    assert_same_warnings(call, tmp_path)


@pytest.mark.parametrize(("folder", "suffix"), [("images", ".jpg"), ("images/camera", ".png"), ("photographs", ".png")])
def test_colmap_images_elsewhere(
    call: Call, ring: Ring, colmap_files: ColmapFiles, tmp_path: Path, folder: str, suffix: str
) -> None:
    """In another folder, or with another suffix, and with one more image than the model registers."""
    colmap_files.write(tmp_path / "sparse" / "0")
    ring.write_images(tmp_path / folder)
    for path in [*(tmp_path / folder).iterdir()]:
        path.rename(path.with_suffix(suffix))
    shutil.copy(path.with_suffix(suffix), tmp_path / folder / f"more{suffix}")
    assert_same_warnings(call, tmp_path)


@pytest.mark.parametrize("root", ["/home/me/", "C:\\me\\images\\"])
@pytest.mark.parametrize("place", ["", "dense/"])
def test_absolute_names_of_colmap_images(call: Call, ring: Ring, tmp_path: Path, place: str, root: str) -> None:
    """Those of the folder beside the model come first."""
    ring.write_images(tmp_path / "images")
    ring.write_images(tmp_path / place / "images")
    model = tmp_path / place / "sparse"
    model.mkdir(parents=True)
    (model / "cameras.txt").write_text("1 SIMPLE_PINHOLE 16 12 20 8 6\n")
    lines = (f"{number} 1 0 0 0 0 0 {number} 1 {root}{name}\n\n" for number, name in enumerate(ring.names))
    (model / "images.txt").write_text("".join(lines))
    assert_same(call, tmp_path)
    assert read(call, tmp_path)["frames"][0]["name"] == f"{place}images/{ring.names[0]}"


@pytest.mark.parametrize("part", ["cameras", "images", "points3D"])
def test_colmap_cut_short(call: Call, ring: Ring, colmap_files: ColmapFiles, tmp_path: Path, part: str) -> None:
    ring.write_images(tmp_path / "images")
    colmap_files.write(tmp_path / "sparse" / "0")
    path = tmp_path / "sparse" / "0" / f"{part}.bin"
    whole = path.read_bytes()
    for end in (0, 7, 30, len(whole) - 1):
        path.write_bytes(whole[:end])
        with pytest.raises(Error, match=rf"{part}\.bin|sparse/0"):
            read(call, tmp_path)


def write_part(folder: Path, colmap_files: ColmapFiles, count: int = 10, root: str = "") -> None:
    """The first images of the ring as a text model, below another folder if one is given."""
    colmap_files.write(folder, "text")
    lines = colmap_files.text["images"].replace("view_", f"{root}view_").splitlines(keepends=True)
    (folder / "images.txt").write_text("".join(lines[: 1 + 2 * count]))


@pytest.mark.parametrize("place", ["sparse/{}", "dense/{}/sparse"])
def test_the_largest_model(call: Call, ring: Ring, colmap_files: ColmapFiles, tmp_path: Path, place: str) -> None:
    ring.write_images(tmp_path / "images")
    for name, count in (("2", 3), ("10", 7), ("notes", 10)):
        write_part(tmp_path / place.format(name), colmap_files, count)
    assert_same_warnings(call, tmp_path)
    assert len(read(call, tmp_path)["frames"]) == 7


@pytest.mark.parametrize("images", ["images", "pictures"])
def test_images_beside_the_largest_model(
    call: Call, ring: Ring, colmap_files: ColmapFiles, tmp_path: Path, images: str
) -> None:
    """They go before undistorted ones, and are found by name as those of a model that is alone."""
    ring.write_images(tmp_path / images)
    for name, count in (("sparse/0", 3), ("sparse/1", 7)):
        write_part(tmp_path / name, colmap_files, count)
    if images == "images":
        write_part(tmp_path / "dense/sparse", colmap_files, 3)
        ring.write_images(tmp_path / "dense/images")
    assert_same_warnings(call, tmp_path)
    assert [frame["name"] for frame in read(call, tmp_path)["frames"]] == [f"{images}/{n}" for n in ring.names[:7]]


@pytest.mark.parametrize("root", ["", "/data/me/photos/", "C:\\photos\\", "sub\\"])
@pytest.mark.parametrize("originals", [False, True])
def test_a_model_beside_its_own_images(
    call: Call, ring: Ring, colmap_files: ColmapFiles, tmp_path: Path, root: str, originals: bool
) -> None:
    """Undistorted images have a model of their own, which fits them alone."""
    write_part(tmp_path / "sparse/0", colmap_files, root=root)
    (tmp_path / "sparse/0/cameras.txt").write_text("3 SIMPLE_RADIAL 16 12 20 8 6 -0.08\n")
    write_part(tmp_path / "dense/0/sparse", colmap_files, root=root)
    below = "sub" if "sub" in root else ""
    ring.write_images(tmp_path / "dense/0/images" / below)
    if originals:
        ring.write_images(tmp_path / "images" / below)
    assert_same(call, tmp_path)
    assert read(call, tmp_path)["frames"][0]["name"].startswith("images/" if originals else "dense/0/images/")


def test_images_of_another_model(call: Call, ring: Ring, colmap_files: ColmapFiles, tmp_path: Path) -> None:
    write_part(tmp_path / "sparse/0", colmap_files)
    write_part(tmp_path / "flat/sparse", colmap_files)
    ring.write_images(tmp_path / "flat/images")
    assert_same_refusal(call, tmp_path, "holds none of the 10 registered images")
    ring.write_images(tmp_path / "originals")
    assert_same_warnings(call, tmp_path)


def test_images_without_a_pose(call: Call, ring: Ring, colmap_files: ColmapFiles, tmp_path: Path) -> None:
    """They are counted where they are the most."""
    ring.write_images(tmp_path / "images")
    write_part(tmp_path / "sparse/0", colmap_files, 5)
    assert_same_warnings(call, tmp_path)
    shutil.copy(tmp_path / "images" / ring.names[0], tmp_path / "images/more.png")
    assert_same_warnings(call, tmp_path)
    [warning] = read(call, tmp_path)["warnings"]
    assert warning == "only 5 of 11 images have a pose in the COLMAP model: let pocketgs pose find all anew"
    (tmp_path / "posed.json").write_text("{}")  # of pocketgs pose, which has told
    assert read(call, tmp_path)["warnings"] == []
