"""The page reads captures as Python does: the same frames, cameras, lenses, clouds and splits."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Error
from plyfile import PlyData, PlyElement

from capture.conftest import ColmapFiles, Ring
from pocketgs.capture.masks import with_masks
from pocketgs.capture.open import read_listing
from static_site.reading import assert_same, assert_same_refusal, assert_same_warnings, read

Call = Callable[..., Any]


def changed(folder: Path, change: Callable[[dict[str, Any]], object]) -> Path:
    """With another transforms.json."""
    file = folder / "transforms.json"
    document = json.loads(file.read_text())
    change(document)
    file.write_text(json.dumps(document))
    return folder


def test_nerfstudio(call: Call, capture_folder: Path) -> None:
    assert_same(call, capture_folder)


def test_photographs_without_a_pose_are_counted(call: Call, ring: Ring, tmp_path: Path) -> None:
    ring.write_images(tmp_path / "images")
    stated = ring.transforms()
    (tmp_path / "transforms.json").write_text(json.dumps({**stated, "frames": stated["frames"][:5]}))
    assert_same_warnings(call, tmp_path)
    shutil.copy(tmp_path / "images" / ring.names[0], tmp_path / "images/more.png")
    assert_same_warnings(call, tmp_path)
    [warning] = read(call, tmp_path)["warnings"]
    assert warning.startswith("only 5 of 11 images have a pose in transforms.json")


def test_folders_around_a_capture(call: Call, capture_folder: Path) -> None:
    assert len(read(call, capture_folder.parent)["frames"]) == 8
    shutil.copytree(capture_folder, capture_folder.parent / "archive" / "of" / "capture")
    assert len(read(call, capture_folder.parent / "archive")["frames"]) == 8
    shutil.copytree(capture_folder, capture_folder.parent / "deep" / "a/b/c/d/e/f")
    assert len(read(call, capture_folder.parent / "deep")["frames"]) == 8


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


def test_frames_without_a_pose(call: Call, capture_folder: Path) -> None:
    def change(document: dict[str, Any]) -> None:
        document["frames"][1]["transform_matrix"] = None
        del document["frames"][2]["transform_matrix"]
        document["frames"][4]["file_path"] = "images/absent.png"

    assert_same_warnings(call, changed(capture_folder, change))
    changed(capture_folder, lambda document: [frame.pop("transform_matrix", 0) for frame in document["frames"][4:6]])
    assert_same_refusal(call, capture_folder, r"frames\[1\].*field 'transform_matrix' is (None|null)")


@pytest.mark.parametrize("accent", ["\u00e9", "e\u0301"])
def test_splits_of_other_systems(call: Call, capture_folder: Path, accent: str) -> None:
    """Separators, case and the encoding of accents may differ, as long as one means the same file."""

    def change(document: dict[str, Any]) -> None:
        frames = document["frames"]
        for frame in frames[:2]:
            path = Path(frame["file_path"])
            named = path.with_name(f"caf\u00e9_{path.name}")
            (capture_folder / path).rename(capture_folder / named)
            frame["file_path"] = f"./{named.as_posix()}"
        paths = [frame["file_path"].replace("\u00e9", accent) for frame in frames]
        document["train_filenames"] = [path.replace("/", "\\") for path in paths[2:]]
        document["test_filenames"] = [path.removeprefix("./").upper() for path in paths[:2]]

    assert_same_warnings(call, changed(capture_folder, change))
    assert len(read(call, capture_folder)["heldOut"]) == 2


@pytest.mark.parametrize("lists", [{"train": 5}, {"train": 8, "test": 3}, {"train": 4, "val": -2, "test": -1}])
@pytest.mark.parametrize("unknown", [(), ("gone/0.png", "gone/1.png")])
def test_lists_of_splits(call: Call, capture_folder: Path, lists: dict[str, int], unknown: tuple[str, ...]) -> None:
    """The first frames or the last, be they trained on too, and paths of none."""

    def change(document: dict[str, Any]) -> None:
        paths = [frame["file_path"] for frame in document["frames"]]
        for name, count in lists.items():
            document[f"{name}_filenames"] = [*unknown, *(paths[:count] if count > 0 else paths[count:])]

    assert_same_warnings(call, changed(capture_folder, change))


@pytest.mark.parametrize("name", ["train_filenames", "val_filenames", "test_filenames"])
def test_splits_that_name_no_frame(call: Call, capture_folder: Path, name: str) -> None:
    def change(document: dict[str, Any]) -> None:
        document["test_filenames"] = [document["frames"][2]["file_path"]]
        document |= {name: ["gone/0.png", "gone/1.png"], "val_filenames": []} if "val" not in name else {name: ["gone"]}

    assert_same_warnings(call, changed(capture_folder, change))
    assert f"paths in {name} are no file_path of a frame: correct them" in read(call, capture_folder)["warnings"][0]


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


@pytest.mark.parametrize("stated", ["../photographs/{name}", "photographs/{name}", "..\\photographs\\{name}"])
def test_photographs_beside_the_folder_of_the_poses(
    call: Call, capture_folder: Path, stated: str, tmp_path: Path
) -> None:
    """Programs state paths from the folder of their output, or from where they were run; masks and clouds too."""
    beside = stated.replace("photographs", "shown")
    restated(capture_folder, "mask_path", lambda path: beside.format(name=Path(path).name))
    restated(capture_folder, "file_path", lambda path: stated.format(name=Path(path).name))
    cloud = beside.format(name="cloud.ply")
    changed(capture_folder, lambda document: document.update(ply_file_path=cloud))
    around = tmp_path / "walk"
    (around / "deep/poses").mkdir(parents=True)
    (around / "deep/shown").mkdir()
    shutil.move(capture_folder / "transforms.json", around / "deep/poses")
    shutil.move(capture_folder / "cloud.ply", around / "deep/shown")
    photographs = Path(shutil.move(capture_folder / "images", around / "deep/photographs"))
    with pytest.raises(Error, match=r"outside the capture's folder|none of the 8 listed frames"):
        read(call, around / "deep/poses")
    first = min(photographs.iterdir())
    Image.fromarray(np.full((72, 96), 255, np.uint8)).save(around / "deep/shown" / first.name)
    found, expected = read(call, around), read_listing(around)
    assert [frame["name"] for frame in found["frames"]] == [frame.name for frame in expected.frames]
    masks = [frame["mask"] for frame in found["frames"]]
    assert masks == [f"../shown/{first.name}", *[None] * 7]
    assert [frame.mask_path is not None for frame in expected.frames] == [True, *[False] * 7]
    assert len(found["cloud"][0]) == 3 * len(expected.points)  # type: ignore[arg-type]
    assert len(found["warnings"]) == len(expected.warnings) - 1  # Python names the folder that it uses


def test_masks_beside_a_folder_beside_the_poses(call: Call, capture_folder: Path, tmp_path: Path) -> None:
    restated(capture_folder, "file_path", lambda path: f"../images/{Path(path).name}")
    (tmp_path / "walk/poses").mkdir(parents=True)
    shutil.move(capture_folder / "transforms.json", tmp_path / "walk/poses")
    shutil.copytree(capture_folder / "images", tmp_path / "walk/masks")
    shutil.move(capture_folder / "images", tmp_path / "walk/images")
    found = read(call, tmp_path / "walk")["frames"]
    expected = with_masks(read_listing(tmp_path / "walk"), tmp_path / "walk/poses", "found")
    assert all(frame.mask_path for frame in expected.frames)
    assert [frame["mask"] for frame in found] == [frame["name"].replace("images", "masks") for frame in found]


def test_images_with_another_suffix(call: Call, capture_folder: Path) -> None:
    assert_same(call, restated(capture_folder, "file_path", lambda path: path.replace(".png", ".JPG")))
    assert len(read(call, capture_folder)["frames"]) == 8
    first = next((capture_folder / "images").iterdir())
    shutil.copy(first, first.with_suffix(".jpeg"))
    assert_same(call, capture_folder)


def test_converted_images_of_another_machine(call: Call, capture_folder: Path) -> None:
    """They are found by their names with another suffix, unless several have one."""
    restated(capture_folder, "file_path", lambda path: f"/home/me/scan/{Path(path).stem}.jpeg")
    assert_same(call, capture_folder)
    assert len(read(call, capture_folder)["frames"]) == 8
    first, second, *_ = sorted((capture_folder / "images").iterdir())
    first.unlink()
    shutil.copy(second, second.with_suffix(".jpg"))
    assert_same(call, capture_folder)
    assert len(read(call, capture_folder)["frames"]) == 6


@pytest.mark.parametrize("place", ["images", "/home/me/gone"])
def test_other_pictures_of_the_same_stem(call: Call, capture_folder: Path, place: str) -> None:
    """They are no photographs where the others were not converted, nor are masks."""
    first, second, *_ = sorted((capture_folder / "images").iterdir())
    first.rename(first.with_suffix(".jpeg"))
    restated(capture_folder, "file_path", lambda path: f"{place}/{Path(path).name}".replace(second.name, "gone.png"))
    assert_same(call, capture_folder)
    assert len(read(call, capture_folder)["frames"]) == 6
    restated(capture_folder, "file_path", lambda path: path.replace(".png", ".jfif"))
    restated(capture_folder, "mask_path", lambda path: f"/scan/images/{Path(path).stem}.png")
    assert_same(call, capture_folder)
    assert [frame["name"] for frame in read(call, capture_folder)["frames"]] == [f"images/{first.stem}.jpeg"]


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


def test_backslashes_in_paths(call: Call, capture_folder: Path) -> None:
    """Of images, masks, depth maps and the cloud."""
    (capture_folder / "sub").mkdir()
    shutil.move(capture_folder / "cloud.ply", capture_folder / "sub/cloud.ply")
    Image.fromarray(np.full((72, 96), 255, np.uint8)).save(capture_folder / "sub/mask.png")
    Image.fromarray(np.full((72, 96), 1500, np.uint16)).save(capture_folder / "sub/depth.png")

    def change(document: dict[str, Any]) -> None:
        document["ply_file_path"] = ".\\sub\\cloud.ply"
        for frame in document["frames"]:
            stated = {"mask_path": "sub\\mask.png", "depth_file_path": ".\\sub\\depth.png"}
            frame |= {**stated, "file_path": frame["file_path"].replace("/", "\\")}

    assert_same_warnings(call, changed(capture_folder, change))
    assert read(call, capture_folder)["warnings"] == []
    outside = changed(capture_folder, lambda document: document["frames"][0].update(mask_path="..\\mask.png"))
    assert_same_refusal(call, outside, "which lies outside the capture's folder")


@pytest.mark.parametrize("suffix", [".jpe", ".JFIF"])
def test_other_suffixes_of_jpeg(call: Call, capture_folder: Path, suffix: str) -> None:
    for path in [*(capture_folder / "images").iterdir()]:
        Image.open(path).save(path.with_suffix(suffix), "jpeg")
        path.unlink()
    assert_same_warnings(call, restated(capture_folder, "file_path", lambda path: f"gone/{Path(path).stem}{suffix}"))


def test_fields_of_view_and_no_cloud(call: Call, capture_folder: Path) -> None:
    def change(document: dict[str, Any]) -> None:
        for name in ("fl_x", "fl_y", "cx", "cy", "w", "h", "ply_file_path"):
            del document[name]
        document["camera_angle_x"] = 0.9

    assert_same(call, changed(capture_folder, change))


@pytest.mark.parametrize(
    "own", [{"camera_angle_x": 0.9}, {"K": [[90, 0, 47], [0, 91, 35], [0, 0, 1]]}, {"width": 48, "height": 36}]
)
def test_what_frames_state_otherwise(call: Call, capture_folder: Path, own: dict[str, Any]) -> None:
    def change(document: dict[str, Any]) -> None:
        document["distortion_params"] = [0.1, 0.2, 0.3, 0, 0.5, 0.6]
        for frame in document["frames"][1:]:
            frame |= own | {"k1": "-0.01"}
        document["frames"][2] |= {"is_fisheye": True, "distortion_params": [0.1, 0.2, 0.3, 0.4, 0, 0]}

    assert_same(call, changed(capture_folder, change))


@pytest.mark.parametrize(("name", "value"), [("is_fisheye", "true"), ("is_fisheye", 1), ("metric", 1)])
def test_what_is_neither_true_nor_false(call: Call, capture_folder: Path, name: str, value: object) -> None:
    changed(capture_folder, lambda document: document.update({name: value}))
    assert_same_refusal(call, capture_folder, f"field '{name}' is .*, expected true or false")


def test_numbers_that_only_python_writes(call: Call, capture_folder: Path) -> None:
    """Where nobody needs them; words in texts are none."""

    def change(document: dict[str, Any]) -> None:
        document |= {"sharpness": float("nan"), "bounds": [-float("inf"), float("inf")]}
        first = document["frames"][0]
        moved = 'images/a "NaN, Infinity.png'
        (capture_folder / first["file_path"]).rename(capture_folder / moved)
        first["file_path"] = moved

    assert_same_warnings(call, changed(capture_folder, change))
    changed(capture_folder, lambda document: document.update(fl_x=float("nan")))
    assert_same_refusal(call, capture_folder, "field 'fl_x' is .*, expected a finite number")


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


@pytest.mark.parametrize(("kind", "full"), [("u2", 65535), ("u2", 255), ("f4", 1), ("f4", 255)])
def test_colours_of_clouds(call: Call, capture_folder: Path, kind: str, full: int) -> None:
    vertices = PlyData.read(str(capture_folder / "cloud.ply"), mmap=False)["vertex"].data
    types = [(name, kind if name in ("red", "green", "blue") else "f4") for name in vertices.dtype.names]
    columns = [vertices[name] * (full / 255 if kind == of else 1) for name, of in types]
    restated = np.rec.fromarrays(columns, dtype=types)
    PlyData([PlyElement.describe(np.asarray(restated), "vertex")]).write(str(capture_folder / "cloud.ply"))
    assert_same(call, capture_folder)


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
    assert_same_warnings(call, tmp_path)
    # People leave out the test images to save space. Training images have the same names, and every eighth is held out.
    shutil.rmtree(tmp_path / "test", ignore_errors=True)
    assert_same_warnings(call, tmp_path)
    shutil.rmtree(tmp_path / "train")
    assert_same_refusal(
        call, tmp_path, "_train.json: none of the 10 listed frames has an image file, the first .*view_00"
    )
    (tmp_path / "transforms_train.json").write_text(json.dumps({"frames": []}))
    assert_same_refusal(call, tmp_path, r"transforms_train\.json: lists no frame, expected at least one")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda d: d.pop("frames"), "field 'frames' is nothing, expected a list of objects"),
        (lambda d: d.update(fl_x="wide"), "field 'fl_x' is .*, expected a finite number"),
        (lambda d: d.update(k4="0.02"), "coefficient k4 is 0.02, a fourth radial term"),
        (lambda d: d.update(camera_model="ORTHO"), "camera_model' is ORTHO, expected one of"),
        (lambda d: (d.pop("fl_x"), d.pop("fl_y")), "no focal length"),
        (lambda d: d["frames"][1].update(transform_matrix=[[1, 2], [3, 4]]), r"frames\[1\].*expected a matrix"),
        (lambda d: d["frames"][1]["transform_matrix"][0].__setitem__(0, 9), r"frames\[1\]: the pose is not rigid"),
        (lambda d: d["frames"][1].update(file_path=d["frames"][0]["file_path"]), "more than once"),
        (lambda d: [f["transform_matrix"][0].__setitem__(3, 4e6) for f in d["frames"][1:]], "near the origin"),
        (lambda d: [f.update(file_path="absent.png") for f in d["frames"]], "none of the 8 listed frames has an image"),
        (lambda d: d.update(frames=[]), r"transforms\.json: lists no frame, expected at least one"),
        (
            lambda d: d.update(equirectangular=True),
            r"frames\[0\]: field 'equirectangular' states another lens, expected",
        ),
        (lambda d: d["frames"][2].update(ftheta_p0=0), r"frames\[2\]: field 'ftheta_p0' states another lens, expected"),
    ],
)
def test_what_is_wrong_is_named(
    call: Call, capture_folder: Path, change: Callable[[dict[str, Any]], object], words: str
) -> None:
    with pytest.raises(Error, match=words):
        read(call, changed(capture_folder, change))


@pytest.mark.parametrize("value", [False, None])
def test_other_lenses_that_are_not_meant(call: Call, capture_folder: Path, value: bool | None) -> None:
    assert_same(call, changed(capture_folder, lambda document: document.update(latlong=value, orthographic=value)))


@pytest.mark.parametrize(
    ("names", "words"),
    [
        (["notes.txt"], "not a capture of a format that this page reads: expected transforms"),
        (["a/0.jpg", "a/1.JPG"], r"\(it holds photographs without camera poses, .* finds\): expected transforms"),
        (["walk.MOV"], "it holds a video without camera poses"),
        (["a/cap.zip", "a/0.jpg"], "it holds cap.zip: choose that alone"),
        (["a/one.r3d", "b/two.R3D"], "2 recordings are in one, such as (one.r3d|two.R3D): choose one of them"),
    ],
)
def test_what_is_no_capture(call: Call, tmp_path: Path, names: list[str], words: str) -> None:
    for name in names:
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("nothing")
    with pytest.raises(Error, match=words):
        read(call, tmp_path)


def test_two_captures_are_not_one(call: Call, capture_folder: Path, tmp_path: Path) -> None:
    for name in ("a", "b"):
        shutil.copytree(capture_folder, tmp_path / "both" / name)
    with pytest.raises(Error, match="2 captures are in one: choose one of them"):
        read(call, tmp_path / "both")
