"""Images that are not at the paths that the capture states."""

from __future__ import annotations

import shutil
import unicodedata
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pocketgs.capture import open_capture
from pocketgs.capture.open import lacks_poses, read_listing
from pocketgs.capture.unposed import find_photographs, only_video
from pocketgs.errors import PocketGSError
from pocketgs.files.paths import is_folder_of_photographs
from pocketgs.structure_from_motion.images import source_files


def link(path: Path, target: Path) -> None:
    """A symbolic link to a folder."""
    try:
        path.symlink_to(target, target_is_directory=True)
    except OSError as error:
        pytest.skip(f"no links here: {error}")


@pytest.mark.parametrize(
    "stated", ["/home/someone/scan/images/{}", "C:\\scans\\images\\{}", "../images/{}", "input/{}", "./frames/rgb/{}"]
)
def test_paths_of_another_machine(ring, write_transforms, stated):
    frames = ring.transforms()["frames"]
    for frame, name in zip(frames, ring.names, strict=True):
        frame["file_path"] = stated.format(name)
    folder = write_transforms(frames=frames)
    (folder / "depths").mkdir()
    shutil.copy(folder / "images/view_00.png", folder / "depths")
    capture = open_capture(folder, hold_out=0)
    assert [frame.name for frame in capture.train] == [f"images/{name}" for name in ring.names]
    assert "10 of 10 were found by their names, such as images/view_00.png for" in capture.warnings[0]
    np.testing.assert_array_equal(capture.train[3].image, ring.images[3])


@pytest.mark.parametrize("stated", ["../photographs/{}", "photographs/{}"])
def test_photographs_beside_the_folder_of_the_poses(ring, write_transforms, stated, tmp_path):
    """Programs state paths from the folder of their output, or from where they were run."""
    frames = ring.transforms()["frames"]
    for frame, name in zip(frames, ring.names, strict=True):
        frame |= {"file_path": stated.format(name), "mask_path": stated.format(name).replace("photographs", "shown")}
    folder, around = write_transforms(frames=frames), tmp_path / "walk"
    (around / "poses").mkdir(parents=True)
    shutil.move(folder / "transforms.json", around / "poses")
    shutil.move(folder / "images", around / "photographs")
    with pytest.raises(PocketGSError, match=r"a folder that holds both|none of the 10 listed frames"):
        read_listing(around / "poses")
    for masks in ("shown", "others"):
        (around / masks).mkdir()
        Image.new("L", ring.images[3].shape[1::-1], 255).save(around / masks / ring.names[3])
    shutil.copytree(around / "photographs", around / "copies")
    link(tmp_path / "linked", around)
    for path in (around, tmp_path / "linked"):
        capture = open_capture(path, hold_out=0)
        assert [frame.name for frame in capture.train] == [f"../photographs/{name}" for name in ring.names]
        np.testing.assert_array_equal(capture.train[3].image, ring.images[3])
        for masks in ("found", "others"):
            capture = open_capture(path, hold_out=0, masks=masks)
            assert [frame.mask is not None for frame in capture.train] == [at == 3 for at in range(10)]
        for images in ("copies", "../copies", str(path / "copies")):
            assert read_listing(path, images).frames[0].name == f"../copies/{ring.names[0]}"
    with pytest.raises(PocketGSError, match="lies outside the capture's folder"):
        read_listing(around, str(tmp_path / "elsewhere"))


def test_photographs_of_another_capture_are_not_taken(ring, write_transforms, tmp_path):
    """In a folder of downloads, names alone say little: a capture without its photographs has none."""
    folder, around = write_transforms(), tmp_path / "downloads"
    (around / "scan").mkdir(parents=True)
    shutil.move(folder / "transforms.json", around / "scan")
    shutil.move(folder / "images", around / "holiday")
    with pytest.raises(PocketGSError, match="none of the 10 listed frames"):
        read_listing(around)


def test_converted_photographs_of_another_machine(ring, write_transforms):
    frames = ring.transforms()["frames"]
    for frame, name in zip(frames, ring.names, strict=True):
        frame["file_path"] = f"/home/someone/scan/images/{Path(name).stem}.jpeg"
    folder = write_transforms(frames=frames)
    assert [frame.name for frame in read_listing(folder).frames] == [f"images/{name}" for name in ring.names]
    (folder / "images/view_02.png").unlink()
    listing = read_listing(folder)
    assert len(listing.frames) == 9
    assert any("1 of 10 listed frames have no image file" in warning for warning in listing.warnings)
    shutil.copy(folder / "images/view_03.png", folder / "images/view_03.jpg")  # which of them is not known
    assert len(read_listing(folder).frames) == 8


def test_the_fullest_resolution_is_taken(ring, write_transforms):
    frames = ring.transforms("photographs")["frames"]
    folder = write_transforms(frames=frames)
    shutil.copytree(folder / "images", folder / "images_2")
    assert read_listing(folder).frames[0].name == "images/view_00.png"
    shutil.copytree(folder / "images", folder / "copies")
    with pytest.raises(PocketGSError, match="none of the 10 listed frames has an image file"):
        read_listing(folder)


def test_missing_ones_are_not_sought_where_others_are_found(write_transforms):
    folder = write_transforms()
    (folder / "other").mkdir()
    shutil.move(folder / "images/view_02.png", folder / "other/view_02.png")
    listing = read_listing(folder)
    assert len(listing.frames) == 9
    assert "1 of 10 listed frames have no image file" in listing.warnings[0]


def test_a_missing_photograph_is_not_replaced_by_another_picture(ring, write_transforms):
    """Of the same stem, where the others were not converted: not even by name alone."""
    frames = ring.transforms()["frames"]
    for frame, name in zip(frames, ring.names, strict=True):
        frame["file_path"] = f"images/{name}".replace("view_00.png", "view_00.jpg")
    folder = write_transforms(frames=frames)
    (folder / "images/view_03.png").rename(folder / "images/view_03.jpg")
    assert len(read_listing(folder).frames) == 9
    (folder / "images").rename(folder / "other")
    listing = read_listing(folder)
    assert [frame.name for frame in listing.frames][:4] == [f"other/view_0{at}.png" for at in (0, 1, 2, 4)]


@pytest.mark.parametrize("field", ["mask_path", "depth_file_path"])
@pytest.mark.parametrize("root", ["", "/home/someone/scan/"])
def test_masks_and_depth_are_no_photographs(ring, write_transforms, field, root):
    frames = ring.transforms()["frames"]
    for frame, name in zip(frames, ring.names, strict=True):
        frame |= {field: f"{root}images/{name}", "file_path": f"images/{Path(name).stem}.jpg"}
    with pytest.raises(PocketGSError, match="none of the 10 listed frames has an image file"):
        read_listing(write_transforms(frames=frames))


def test_spellings(ring, write_transforms):
    stated = ["VIEW_00.PNG", unicodedata.normalize("NFC", "café été.png"), "view_02.jpg", "a b.png", "view_04"]
    frames = ring.transforms()["frames"][:5]
    for frame, name in zip(frames, stated, strict=True):
        frame["file_path"] = f"images/{name}"
    folder = write_transforms(frames=frames)
    images = folder / "images"
    images.joinpath("view_01.png").rename(images / unicodedata.normalize("NFD", "café été.png"))
    images.joinpath("view_03.png").rename(images / "a b.png")
    images.joinpath("view_04.png").rename(images / "view_04.JPEG")
    listing = read_listing(folder)
    assert (len(listing.frames), listing.warnings) == (5, ())


def test_colmap_images_beside_the_model(ring, colmap_files, tmp_path):
    colmap_files.write(tmp_path / "dense/sparse")
    ring.write_images(tmp_path / "my photos")
    assert read_listing(tmp_path).frames[0].name == "my photos/view_00.png"
    shutil.move(tmp_path / "my photos", tmp_path / "images_4")
    for file in sorted((tmp_path / "images_4").iterdir()):
        Image.open(file).resize((8, 6)).save(file.with_suffix(".JPG"))
        file.unlink()
    capture = open_capture(tmp_path)
    assert (capture.warnings, capture.train[0].camera.fx) == ((), 10.0)


def test_one_folder_too_high(write_transforms, tmp_path):
    folder = write_transforms()
    outer = tmp_path / "unpacked"
    outer.mkdir()
    for name in ("images", "transforms.json"):
        shutil.move(folder / name, outer / name)
    (tmp_path / "__MACOSX").mkdir()
    (outer / "images/._view_00.png").write_bytes(b"\0\5\x16\7")
    capture = open_capture(tmp_path)
    assert "using the one in it, unpacked" in capture.warnings[0]
    assert len(capture.frames) == 10
    assert not lacks_poses(tmp_path)
    shutil.copytree(outer, tmp_path / "second")
    with pytest.raises(PocketGSError, match=r"holds 2 captures, second, unpacked: name one of them"):
        open_capture(tmp_path)


def test_photographs_in_the_only_folder_of_photographs(ring, tmp_path):
    ring.write_images(tmp_path / "photos")
    ring.write_images(tmp_path / "masks")
    assert [path.name for path in find_photographs(tmp_path)] == ring.names
    assert lacks_poses(tmp_path)
    ring.write_images(tmp_path / "more")
    assert find_photographs(tmp_path) == []


def test_photographs_as_cameras_nest_them(ring, tmp_path):
    ring.write_images(tmp_path / "card/DCIM/100APPLE")
    ring.write_images(tmp_path / "card/MISC/thumbs")
    assert [path.name for path in find_photographs(tmp_path / "card")] == ring.names
    assert lacks_poses(tmp_path / "card")
    ring.write_images(tmp_path / "card/DCIM/101APPLE")
    assert find_photographs(tmp_path / "card") == []
    with pytest.raises(PocketGSError, match=r"several folders, DCIM/100APPLE \(10\), DCIM/101APPLE \(10\): move them"):
        open_capture(tmp_path / "card")
    # Those that are less deep are meant.
    ring.write_images(tmp_path / "card/best")
    assert {path.parent.name for path in find_photographs(tmp_path / "card")} == {"best"}


@pytest.mark.parametrize(
    ("name", "is_one"),
    [
        ("conference room", True),
        ("Segovia", True),
        ("normandy", True),
        ("depths of the sea", False),
        *((name, False) for name in ("masks", "Mask_2", "masked_images", "depth", "depthmaps", "depth2", "conf")),
        *((name, False) for name in ("confidence", "seg", "segmentation_x", "normals", "labels", "thumbnails")),
        *((name, False) for name in ("previews", "held_out", "transients", ".hidden", "__MACOSX")),
    ],
)
def test_folders_of_other_pictures_are_told_by_whole_words(tmp_path, name, is_one):
    (tmp_path / name).mkdir()
    assert is_folder_of_photographs(tmp_path / name) == is_one


@pytest.mark.parametrize("kind", ["nerfstudio", "colmap"])
def test_images_by_an_absolute_path(ring, write_transforms, colmap_files, tmp_path, tmp_path_factory, kind):
    folder = write_transforms() if kind == "nerfstudio" else tmp_path / "scan"
    if kind == "colmap":
        colmap_files.write(folder / "sparse/0")
    ring.write_images(folder / "images_2")
    link = tmp_path_factory.mktemp("links") / "link"
    link.symlink_to(folder)
    for given, images in [(folder, folder), (link, folder), (folder, link)]:
        frames = read_listing(given, str(images / "images_2")).frames
        assert {frame.name.partition("/")[0] for frame in frames} == {"images_2"}
    for images, said in [("/elsewhere/images_2", "lies outside the capture's folder"), ("images_3", "no such folder")]:
        with pytest.raises(PocketGSError, match=f"{images}: {said}"):
            read_listing(folder, images)


def test_a_picture_beside_the_photographs(ring, tmp_path):
    ring.write_images(tmp_path / "images")
    (tmp_path / f"images/{ring.names[0]}").rename(tmp_path / "cover.png")
    assert [path.name for path in find_photographs(tmp_path)] == ring.names[1:]
    for name in ring.names[1:6]:
        (tmp_path / f"images/{name}").rename(tmp_path / name)
    assert [path.name for path in find_photographs(tmp_path)] == ["cover.png", *ring.names[1:6]]


def test_a_preview_in_the_only_folder_of_photographs(ring, tmp_path):
    """Folders in a folder are searched like the folder itself."""
    ring.write_images(tmp_path / "skull/images")
    (tmp_path / "skull/images" / ring.names[0]).rename(tmp_path / "skull/Preview.png")
    (tmp_path / "skull/turntable.mp4").touch()
    for folder in (tmp_path, tmp_path / "skull"):
        assert [path.name for path in find_photographs(folder)] == ring.names[1:]
        assert only_video(folder) is None
    ring.write_images(tmp_path / "other")
    with pytest.raises(PocketGSError, match=r"several folders, other \(10\), skull/images \(9\): move them"):
        open_capture(tmp_path)


def test_photographs_that_lie_deep(ring, tmp_path):
    """They are not taken, but the message names their folder."""
    outer, deep = tmp_path / "outer", tmp_path / "outer/a/b/c/images"
    ring.write_images(deep)
    (deep / "notes.txt").touch()
    ring.write_images(outer / "a/b/c/masks")
    ring.write_images(tmp_path / "elsewhere")
    link(outer / "a/b/c/link", tmp_path / "elsewhere")
    with pytest.raises(PocketGSError, match=r"format: photographs are in a/b/c/images, 10 of them: name that folder$"):
        open_capture(outer)
    (outer / "a/b/c/more/of/them").mkdir(parents=True)
    for name in ring.names[:3]:
        shutil.move(deep / name, outer / "a/b/c/more/of/them")
    several = r"several folders, a/b/c/images \(7\), a/b/c/more/of/them \(3\): name one of them"
    with pytest.raises(PocketGSError, match=several):
        open_capture(outer)
    # A picture that is found does not hide them.
    (outer / "docs").mkdir()
    shutil.copy(deep / ring.names[5], outer / "docs")
    with pytest.raises(PocketGSError, match="1 photograph; photographs are in several folders, a/b/c/images"):
        source_files(outer)


def test_captures_that_lie_deep(write_transforms, colmap_files, tmp_path):
    outer, deep = tmp_path / "outer", tmp_path / "outer/a/b/c"
    shutil.copytree(write_transforms(), deep, ignore=shutil.ignore_patterns("outer"))
    colmap_files.write(deep / "sparse/0")
    with pytest.raises(PocketGSError, match=r"format: a capture is in a/b/c: name that folder$"):
        open_capture(outer)
    shutil.copytree(deep, outer / "a/d/c")
    with pytest.raises(PocketGSError, match=r"format: captures are in a/b/c, a/d/c: name one of them$"):
        open_capture(outer)


def test_the_search_for_what_lies_deep_is_bounded(ring, tmp_path, monkeypatch):
    ring.write_images(tmp_path / "a/b/c/images")
    (tmp_path / "a/b/more").mkdir()
    for number in range(20):
        (tmp_path / f"a/b/more/{number}.txt").touch()
    monkeypatch.setattr("pocketgs.capture.unrecognised.MAX_ENTRIES", 10)
    with pytest.raises(PocketGSError, match=r"format\. Looked for photographs"):
        open_capture(tmp_path)


def test_folders_that_may_hold_the_registered_images_are_named(ring, colmap_files, tmp_path):
    """Of other names with the same numbers, and several with the same names."""
    colmap_files.write(tmp_path)
    (tmp_path / "cover.png").touch()
    ring.write_images(tmp_path / "originals")
    for name in ring.names:
        (tmp_path / "originals" / name).rename(tmp_path / "originals" / f"ori_{name[5:]}")
    with pytest.raises(
        PocketGSError, match=r"view_00\.png; those in originals may be meant: name the folder by --images"
    ):
        read_listing(tmp_path)
    assert len(read_listing(tmp_path, "originals").frames) == 10
    ring.write_images(tmp_path / "a")
    ring.write_images(tmp_path / "b")
    with pytest.raises(PocketGSError, match="those in a, b, originals may be meant"):
        read_listing(tmp_path)


def test_real_photographs_one_folder_down(data_folder: Path):
    for name, count in (("plush", 97), ("brighton", 18)):
        if (data_folder / name).is_dir():
            assert len(find_photographs(data_folder / name)) == count


MATRIX = [[20.0, 0.0, 8.5], [0.0, 21.0, 6.5], [0.0, 0.0, 1.0]]


@pytest.mark.parametrize("field", ["K", "intrinsics", "intrinsic_matrix", "camera_intrinsics"])
@pytest.mark.parametrize(
    "matrix",
    [MATRIX, np.transpose(MATRIX).tolist(), np.ravel(MATRIX).tolist(), np.pad(MATRIX, ((0, 1), (0, 1))).tolist()],
)
def test_matrices_of_intrinsics(ring, write_transforms, field, matrix):
    frames = [{**frame, field: matrix} for frame in ring.transforms()["frames"]]
    nothing = dict.fromkeys(("fl_x", "fl_y", "cx", "cy"))
    folder = write_transforms(**nothing, frames=frames)
    camera = read_listing(folder).frames[0].camera
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == (20, 21, 8.5, 6.5)


@pytest.mark.parametrize("matrix", [[1, 2], [[1, 0], [0, 1]], "K", [[0] * 3] * 3, np.ones((3, 3)).tolist(), MATRIX[:2]])
def test_broken_matrices_of_intrinsics(ring, write_transforms, matrix):
    frames = [{**frame, "K": matrix} for frame in ring.transforms()["frames"]]
    nothing = dict.fromkeys(("fl_x", "fl_y", "cx", "cy"))
    with pytest.raises(PocketGSError, match="'K'"):
        read_listing(write_transforms(**nothing, frames=frames))
