"""The page reads captures as Python does: the same frames, cameras, lenses, clouds and splits."""

from __future__ import annotations

import base64
import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Error
from plyfile import PlyData

from capture.conftest import ColmapFiles, Ring
from pocketgs.capture.hold_out import choose_held_out
from pocketgs.capture.masks import with_masks
from pocketgs.capture.open import read_listing
from pocketgs.capture.video_file import VideoFrame

Call = Callable[..., Any]

READ = """
    const {FileTree, StoredFile} = await import(new URL("archive/tree.js", location.href));
    const {heldOutOf} = await import(new URL("capture/listing.js", location.href));
    const bytesOf = (text) => Uint8Array.from(atob(text), (character) => character.charCodeAt(0));
    const files = Object.entries(given).map(([path, text]) => {
        return new StoredFile(path, bytesOf(text).length, async () => bytesOf(text));
    });
    const listing = await module.readListing(new FileTree(files), settings.capture);
    return {
        format: listing.format,
        frames: listing.frames.map(({mask, depth, ...frame}) => ({
            ...frame,
            mask: mask?.path ?? null,
            depth: depth && [depth.file.path, depth.unit, depth.confidence?.path ?? null, depth.size],
        })),
        heldOut: [...heldOutOf(listing, settings.run.hold_out_every)].sort(),
        cloud: listing.cloud && [[...listing.cloud.positions], [...listing.cloud.colours]],
        background: listing.background,
        warnings: listing.warnings.length,
    };
"""


def read(call: Call, folder: Path) -> dict[str, Any]:
    files = (path for path in folder.rglob("*") if path.is_file())
    given = {path.relative_to(folder).as_posix(): base64.b64encode(path.read_bytes()).decode() for path in files}
    return call("capture/open.js", READ, given)


def assert_same(call: Call, folder: Path) -> None:
    """With what both find, masks and depth included."""
    found, expected = read(call, folder), with_masks(read_listing(folder), folder, "found")
    assert found["format"] == expected.format
    assert [frame["name"] for frame in found["frames"]] == [frame.name for frame in expected.frames]
    for one, other in zip(found["frames"], expected.frames, strict=True):
        camera = other.camera
        numbers = [one["camera"][name] for name in ("width", "height", "fx", "fy", "cx", "cy")]
        assert numbers == pytest.approx([camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy])
        pose = np.reshape(one["camera"]["world_to_camera"], (4, 4))
        np.testing.assert_allclose(pose, camera.world_to_camera, rtol=0, atol=1e-9)
        assert one["lens"]["model"] == other.lens.model
        coefficients = [*other.lens.coefficients, *[0.0] * 8][: len(one["lens"]["coefficients"])]
        assert one["lens"]["coefficients"] == coefficients
        assert one["border"] == other.border
        assert one["frame"] == (other.image.index if isinstance(other.image, VideoFrame) else None)
        paths = [
            path and Path(str(path)).relative_to(folder).as_posix()
            for path in (other.mask_path, other.depth_path, other.confidence_path)
        ]
        assert one["mask"] == paths[0]
        size = None if other.depth_shape is None else list(other.depth_shape)[::-1]
        assert one["depth"] == (None if paths[1] is None else [paths[1], other.depth_unit, paths[2], size])
    assert found["heldOut"] == sorted(choose_held_out(expected, 8)[0])
    assert found["background"] == list(expected.background)
    assert found["warnings"] == len(expected.warnings)
    assert (found["cloud"] is None) == (expected.points is None)
    if expected.points is not None:
        positions, colours = (np.reshape(values, (-1, 3)) for values in found["cloud"])
        np.testing.assert_array_equal(positions, expected.points.positions)
        np.testing.assert_allclose(colours, expected.points.colours, rtol=0, atol=1e-7)


def changed(folder: Path, change: Callable[[dict[str, Any]], object]) -> Path:
    """With another transforms.json."""
    file = folder / "transforms.json"
    document = json.loads(file.read_text())
    change(document)
    file.write_text(json.dumps(document))
    return folder


def test_nerfstudio(call: Call, capture_folder: Path) -> None:
    assert_same(call, capture_folder)


def test_folders_around_a_capture(call: Call, capture_folder: Path) -> None:
    assert len(read(call, capture_folder.parent)["frames"]) == 8


def test_lenses_splits_and_absent_images(call: Call, capture_folder: Path) -> None:
    def change(document: dict[str, Any]) -> None:
        frames = document["frames"]
        document |= {"k1": 0.1, "p2": -0.01, "camera_model": "OPENCV", "test_filenames": [frames[2]["file_path"]]}
        frames[0] |= {"camera_model": "OPENCV_FISHEYE", "k4": 0.3}
        frames[1] |= {"fl_x": 70.5, "cx": 40}
        frames[3]["file_path"] = "images/absent.png"
        frames[4]["file_path"] = "./" + frames[4]["file_path"]
        frames[5]["transform_matrix"][0][0] += 1e-3  # nearly a rotation

    assert_same(call, changed(capture_folder, change))


def restated(folder: Path, field: str, path_by: Callable[[str], str]) -> Path:
    """With another path in a field of each frame, by that of its image."""

    def change(document: dict[str, Any]) -> None:
        for frame in document["frames"]:
            frame[field] = path_by(frame["file_path"])

    return changed(folder, change)


@pytest.mark.parametrize("present", [("depth",), ("photographs", "Masks"), ("images", "images_2", "normals")])
@pytest.mark.parametrize("stated", ["rgb/{name}", "/home/me/scan/images/{name}", "C:\\scan\\{name}", "../{name}"])
def test_images_that_moved(call: Call, capture_folder: Path, present: tuple[str, ...], stated: str) -> None:
    """They are found by their names, and never among masks, depth maps and the like, which often share these."""
    shutil.move(capture_folder / "images", capture_folder / present[0])
    for other in present[1:]:
        shutil.copytree(capture_folder / present[0], capture_folder / other)
    restated(capture_folder, "file_path", lambda path: stated.format(name=Path(path).name))
    if present == ("depth",):
        with pytest.raises(Error, match=r"none of the 8 listed frames|outside the capture"):
            read(call, capture_folder)
    else:
        assert_same(call, capture_folder)
        assert read(call, capture_folder)["frames"][0]["name"].startswith(f"{present[0]}/")


def test_images_with_another_suffix(call: Call, capture_folder: Path) -> None:
    assert_same(call, restated(capture_folder, "file_path", lambda path: path.replace(".png", ".JPG")))
    assert len(read(call, capture_folder)["frames"]) == 8
    first = next((capture_folder / "images").iterdir())
    shutil.copy(first, first.with_suffix(".jpeg"))
    assert_same(call, capture_folder)


@pytest.mark.parametrize(
    "stated", ["/home/me/masks/{name}", "C:\\scan\\masks\\{name}", "/images/{name}", "gone/{name}"]
)
def test_masks_that_moved(call: Call, capture_folder: Path, stated: str) -> None:
    """Photographs often have the names of their masks, and are none; without its mask a photograph is used whole."""
    shutil.copytree(capture_folder / "images", capture_folder / "masks")
    restated(capture_folder, "mask_path", lambda path: stated.format(name=Path(path).name))
    assert_same(call, capture_folder)


def test_a_cloud_that_moved(call: Call, capture_folder: Path) -> None:
    assert_same(call, changed(capture_folder, lambda document: document.update(ply_file_path="/home/me/cloud.ply")))
    assert read(call, capture_folder)["cloud"] is not None


def test_fields_of_view_and_no_cloud(call: Call, capture_folder: Path) -> None:
    def change(document: dict[str, Any]) -> None:
        for name in ("fl_x", "fl_y", "cx", "cy", "w", "h", "ply_file_path"):
            del document[name]
        document["camera_angle_x"] = 0.9

    assert_same(call, changed(capture_folder, change))


@pytest.mark.parametrize("form", ["rows of three", "rows of four", "nine numbers", "by columns"])
def test_matrices_of_intrinsics(call: Call, capture_folder: Path, form: str) -> None:
    def change(document: dict[str, Any]) -> None:
        for name in ("fl_x", "fl_y", "cx", "cy"):
            del document[name]
        for number, frame in enumerate(document["frames"]):
            matrix = np.array([[90.0 + number, 0, 47], [0, 91, 35], [0, 0, 1]])
            whole = np.eye(4)
            whole[:3, :3] = matrix
            frame["K"] = {
                "rows of three": matrix,
                "rows of four": whole,
                "nine numbers": matrix.ravel(),
                "by columns": matrix.T,
            }[form].tolist()

    assert_same(call, changed(capture_folder, change))


@pytest.mark.parametrize("name", ["{stem}.png", "sub/{name}.png", "m{number:03d}.png"])
def test_masks_beside_the_photographs(call: Call, capture_folder: Path, name: str) -> None:
    photographs = sorted((capture_folder / "images").iterdir())
    for number, path in enumerate(photographs[:-1] if "stem" in name else photographs):
        digits = int("".join(filter(str.isdigit, path.stem)))
        mask = capture_folder / "masks" / name.format(stem=path.stem, name=path.name, number=digits)
        mask.parent.mkdir(parents=True, exist_ok=True)
        Image.fromarray(np.full((72, 96), 255 * (number != 2), np.uint8)).save(mask)
    assert_same(call, capture_folder)
    assert any(frame["mask"] for frame in read(call, capture_folder)["frames"])


@pytest.mark.parametrize("height", [12, 120, 118])
def test_masks_of_originals(call: Call, ring: Ring, colmap_files: ColmapFiles, tmp_path: Path, height: int) -> None:
    """Of another shape than the undistorted images they are not used, and never before masks beside these."""
    ring.write_images(tmp_path / "dense/images")
    colmap_files.write(tmp_path / "dense/sparse")
    for folder in ("masks", "dense/mask"):
        (tmp_path / folder).mkdir()
        for name in ring.names:
            Image.new("L", (160 if height > 100 else 16, height), 255).save(tmp_path / folder / name)
    assert_same(call, tmp_path)
    shutil.rmtree(tmp_path / "dense/mask")
    assert_same(call, tmp_path)


def test_masks_that_the_file_names(call: Call, capture_folder: Path) -> None:
    Image.fromarray(np.zeros((72, 96), np.uint8)).save(capture_folder / "one.png")
    assert_same(call, changed(capture_folder, lambda document: document["frames"][1].update(mask_path="./one.png")))
    assert_same(call, changed(capture_folder, lambda document: document["frames"][1].update(mask_path="two.png")))


def test_depth_maps_that_are_absent(call: Call, capture_folder: Path) -> None:
    Image.fromarray(np.full((36, 48), 1500, np.uint16)).save(capture_folder / "one.png")

    def change(document: dict[str, Any]) -> None:
        for frame, name in zip(document["frames"], ("one", "two", "three"), strict=False):
            frame["depth_file_path"] = f"{name}.png"

    assert_same(call, changed(capture_folder, change))
    assert [frame["depth"] is None for frame in read(call, capture_folder)["frames"][:3]] == [False, True, True]


def test_text_clouds_without_colours(call: Call, capture_folder: Path) -> None:
    cloud = PlyData.read(str(capture_folder / "cloud.ply"), mmap=False)
    cloud.text = True
    cloud.write(str(capture_folder / "cloud.ply"))
    assert_same(call, capture_folder)
    lines = ["ply", "format ascii 1.0", "element vertex 1", "property double z", "property float y", "property int x"]
    (capture_folder / "cloud.ply").write_text("\n".join([*lines, "end_header", "3 2 1", ""]))
    assert_same(call, capture_folder)


@pytest.mark.parametrize("splits", [("train",), ("train", "test")])
def test_blender(call: Call, ring: Ring, tmp_path: Path, splits: tuple[str, ...]) -> None:
    for split in splits:
        ring.write_images(tmp_path / split)
        frames = ring.transforms(f"./{split}")["frames"]
        for frame in frames:
            frame["file_path"] = frame["file_path"].removesuffix(".png")
        document = {"camera_angle_x": 0.8, "frames": frames}
        (tmp_path / f"transforms_{split}.json").write_text(json.dumps(document))
    assert_same(call, tmp_path)
    # People leave out the test images to save space. Training images have the same names, and every eighth is held out.
    shutil.rmtree(tmp_path / "test", ignore_errors=True)
    assert_same(call, tmp_path)


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


def test_renamed_copies(call: Call, ring: Ring, colmap_files: ColmapFiles, tmp_path: Path) -> None:
    colmap_files.write(tmp_path / "sparse" / "0")
    (tmp_path / "images").mkdir()
    for number, image in enumerate(ring.images):
        Image.fromarray(image).save(tmp_path / "images" / f"image{number:03d}.png")
    assert_same(call, tmp_path)


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
    assert_same(call, tmp_path)


@pytest.mark.parametrize("place", ["", "dense/"])
def test_absolute_names_of_colmap_images(call: Call, ring: Ring, tmp_path: Path, place: str) -> None:
    """Those of the folder beside the model come first."""
    ring.write_images(tmp_path / "images")
    ring.write_images(tmp_path / place / "images")
    model = tmp_path / place / "sparse"
    model.mkdir(parents=True)
    (model / "cameras.txt").write_text("1 SIMPLE_PINHOLE 16 12 20 8 6\n")
    lines = (f"{number} 1 0 0 0 0 0 {number} 1 /home/me/{name}\n\n" for number, name in enumerate(ring.names))
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


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda d: d.pop("frames"), "field 'frames' is nothing, expected a list of objects"),
        (lambda d: d.update(fl_x="wide"), "field 'fl_x' is .*, expected a finite number"),
        (lambda d: d.update(camera_model="ORTHO"), "camera_model' is ORTHO, expected one of"),
        (lambda d: (d.pop("fl_x"), d.pop("fl_y")), "no focal length"),
        (lambda d: d["frames"][1].update(transform_matrix=[[1, 2], [3, 4]]), r"frames\[1\].*expected a matrix"),
        (lambda d: d["frames"][1]["transform_matrix"][0].__setitem__(0, 9), r"frames\[1\]: the pose is not rigid"),
        (lambda d: d["frames"][1].update(file_path=d["frames"][0]["file_path"]), "more than once"),
        (lambda d: [f["transform_matrix"][0].__setitem__(3, 4e6) for f in d["frames"]], "near the origin"),
        (lambda d: [f.update(file_path="absent.png") for f in d["frames"]], "none of the 8 listed frames has an image"),
    ],
)
def test_what_is_wrong_is_named(
    call: Call, capture_folder: Path, change: Callable[[dict[str, Any]], object], words: str
) -> None:
    with pytest.raises(Error, match=words):
        read(call, changed(capture_folder, change))


def test_what_is_no_capture(call: Call, tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("nothing")
    with pytest.raises(Error, match="not a capture of a format that this page reads: expected transforms"):
        read(call, tmp_path)
