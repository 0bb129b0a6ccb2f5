"""Copies of photographs for structure from motion, and of their masks."""

from __future__ import annotations

import io
import os
from pathlib import Path

import numpy as np
import pytest
from PIL import ExifTags, Image, TiffImagePlugin

from capture.photographs import PICTURE, on_its_side
from pocketgs.capture.decoding.image_file import read_colour, read_header
from pocketgs.capture.open import lacks_poses
from pocketgs.capture.photograph_copy import names_of_copies, place_masks, place_photograph
from pocketgs.capture.unposed import find_photographs
from pocketgs.errors import PocketGSError
from pocketgs.structure_from_motion.images import source_masks


def place_all(source: Path, placed: Path) -> dict[Path, str]:
    """Place all photographs of a folder in another; returns the names of the copies."""
    names = names_of_copies(find_photographs(source))
    for photograph, name in names.items():
        place_photograph(photograph, placed / name)
    return names


def test_photographs_without_poses_are_placed_upright(tmp_path):
    source, placed = tmp_path / "photos", tmp_path / "placed"
    source.mkdir()
    placed.mkdir()
    pictures = {"a.jpg": 1, "b.jpg": 6, "c.JPG": 3}
    for name, orientation in pictures.items():
        Image.fromarray(PICTURE).save(source / name, quality=95, exif=on_its_side(orientation))
    pytest.importorskip("pillow_heif").register_heif_opener()
    Image.fromarray(PICTURE).save(source / "d.heic")
    Image.fromarray(PICTURE).save(source / "A.heic")  # "A.jpg" would be another photograph's name where case is ignored
    assert lacks_poses(source)
    place_all(source, placed)
    sizes = {file.name: read_header(file) for file in placed.iterdir()}
    assert set(sizes) == {"a.jpg", "A.heic.jpg", "b.jpg", "c.JPG", "d.jpg"}
    assert (sizes["b.jpg"].width, sizes["b.jpg"].height) == (48, 64)
    assert all(header.orientation == 1 for header in sizes.values())
    exif = Image.open(placed / "b.jpg").getexif()
    assert exif[ExifTags.Base.Model] == "Phone"
    assert exif.get_ifd(ExifTags.IFD.Exif)[ExifTags.Base.FocalLengthIn35mmFilm] == 26
    assert np.abs(read_colour(placed / "c.JPG")[0].astype(int) - PICTURE[::-1, ::-1]).mean() < 4
    assert read_header(source / "b.jpg").orientation == 6
    assert source_masks(source, "found") == {}


def test_copies_of_tiff_that_lies_on_its_side(tmp_path: Path) -> None:
    """They are upright, and keep the focal length."""
    stated = TiffImagePlugin.ImageFileDirectory_v2()
    stated[ExifTags.Base.Orientation] = 6
    stated[ExifTags.IFD.Exif] = {ExifTags.Base.FocalLengthIn35mmFilm: 26}
    Image.fromarray(PICTURE).save(tmp_path / "a.tif", tiffinfo=stated)
    place_photograph(tmp_path / "a.tif", tmp_path / "b.jpg")
    with Image.open(tmp_path / "b.jpg") as copy:
        assert (copy.format, copy.size) == ("JPEG", (48, 64))
        assert np.abs(np.asarray(copy).astype(int) - np.rot90(PICTURE, -1)).mean() < 4
        assert ExifTags.Base.Orientation not in copy.getexif()
        assert copy.getexif().get_ifd(ExifTags.IFD.Exif)[ExifTags.Base.FocalLengthIn35mmFilm] == 26


def test_copies_with_opaque_alpha_are_what_their_names_say(tmp_path: Path) -> None:
    source = tmp_path / "a.png"
    Image.fromarray(PICTURE).convert("RGBA").save(source, exif=on_its_side())
    name = names_of_copies([source])[source]
    (tmp_path / "placed").mkdir()
    place_photograph(source, tmp_path / "placed" / name)
    assert (name, read_header(tmp_path / "placed" / name).format) == ("a.png", "PNG")
    np.testing.assert_array_equal(read_colour(tmp_path / "placed" / name)[0], np.rot90(PICTURE, -1))


def test_long_notes_in_exif_are_left_out(tmp_path: Path) -> None:
    """JPEG has room for 64 kB, PNG and HEIF have more."""
    exif = on_its_side()
    exif.get_ifd(ExifTags.IFD.Exif)[ExifTags.Base.MakerNote] = bytes(70_000)
    Image.fromarray(PICTURE).save(tmp_path / "a.png", exif=exif)
    (tmp_path / "placed").mkdir()
    place_photograph(tmp_path / "a.png", tmp_path / "placed/a.jpg")
    stored = Image.open(tmp_path / "placed/a.jpg")
    assert stored.size == (48, 64)
    assert stored.getexif()[ExifTags.Base.Model] == "Phone"
    assert stored.getexif().get_ifd(ExifTags.IFD.Exif)[ExifTags.Base.FocalLengthIn35mmFilm] == 26


def test_names_of_copies_are_unicode(tmp_path: Path) -> None:
    """COLMAP takes no others. Masks have the copies' names."""
    source = tmp_path / "photos"
    source.mkdir()
    written = [os.fsdecode(name) for name in (b"caf\xe9.png", b"caf\xe8.png", b"caf_.png", "weiß.png".encode())]
    for name in written:
        photograph = io.BytesIO()
        Image.fromarray(PICTURE).save(photograph, "PNG")
        try:
            (source / name).write_bytes(photograph.getvalue())
        except OSError:
            pytest.skip("this file system has Unicode names only")
    names = names_of_copies(find_photographs(source))
    copies = {path.name: name for path, name in names.items()}
    assert copies[written[2]] == "caf_.png"
    assert copies[written[3]] == "weiß.png"
    assert {copies[written[0]], copies[written[1]]} == {"caf__2.png", "caf__3.png"}
    place_masks({source / written[0]: source / written[0]}, names, tmp_path / "masks")
    assert [path.name for path in (tmp_path / "masks").iterdir()] == [f"{copies[written[0]]}.png"]


def test_masks_of_photographs_without_poses_are_turned_with_them(tmp_path):
    source, placed = tmp_path / "photos", tmp_path / "placed"
    (source / "mask").mkdir(parents=True)
    placed.mkdir()
    mask = np.zeros((48, 64), np.uint8)
    mask[:10] = 255
    half = mask[::2, ::2]
    cases = {"a": mask, "b": np.rot90(mask, -1), "c": mask, "d": half, "e": np.rot90(half, -1)}
    for name, turned in cases.items():
        Image.fromarray(PICTURE).save(source / f"{name}.jpg", exif=on_its_side())
        Image.fromarray(turned).save(source / f"mask/{name}.png")
    place_masks(source_masks(source, "found"), place_all(source, placed), tmp_path / "masks")
    for name in cases:
        stored = np.asarray(Image.open(tmp_path / f"masks/{name}.jpg.png"))
        np.testing.assert_array_equal(stored, np.rot90(half if name in "de" else mask, -1) > 0)


def test_masks_that_cannot_be_decoded(tmp_path: Path) -> None:
    source, placed = tmp_path / "photos", tmp_path / "placed"
    (source / "mask").mkdir(parents=True)
    placed.mkdir()
    for name in "abc":
        Image.fromarray(PICTURE).save(source / f"{name}.jpg")
        Image.new("L", (64, 48), 255).save(source / f"mask/{name}.png")
    (source / "mask/a.png").write_text("none")
    (source / "mask/b.png").write_bytes((source / "mask/b.png").read_bytes()[:60])
    masks, names = source_masks(source, "found"), place_all(source, placed)
    errors: list[PocketGSError] = []
    place_masks(masks, names, tmp_path / "masks", errors.append)
    assert [error.args[0].partition(":")[0] for error in errors] == [str(source / f"mask/{name}.png") for name in "ab"]
    assert [path.name for path in (tmp_path / "masks").iterdir()] == ["c.jpg.png"]
    with pytest.raises(PocketGSError, match=r"a\.png"):
        place_masks(masks, names, tmp_path / "more")


@pytest.mark.parametrize("ignores_exif", [False, True])
def test_masks_of_photographs_upside_down(tmp_path: Path, ignores_exif: bool) -> None:
    """Their shape does not tell whether a program has followed EXIF, but its other masks and a mask's own EXIF do."""
    source, placed = tmp_path / "photos", tmp_path / "placed"
    (source / "mask").mkdir(parents=True)
    placed.mkdir()
    stored = np.zeros((48, 64), np.uint8)
    stored[:10] = 255
    upright = {"a": np.rot90(stored, 2), "b": np.rot90(stored, 2), "c": np.rot90(stored, -1)}
    for name, orientation in {"a": 3, "b": 3, "c": 6}.items():
        exif = on_its_side(orientation)
        Image.fromarray(PICTURE).save(source / f"{name}.jpg", exif=exif)
        states_it = name == "b"
        mask = stored if ignores_exif or states_it else upright[name]
        Image.fromarray(mask).save(source / f"mask/{name}.png", **({"exif": exif} if states_it else {}))
    place_masks(source_masks(source, "found"), place_all(source, placed), tmp_path / "masks")
    for name, expected in upright.items():
        written = np.asarray(Image.open(tmp_path / f"masks/{name}.jpg.png"))
        np.testing.assert_array_equal(written, expected > 0, err_msg=name)
