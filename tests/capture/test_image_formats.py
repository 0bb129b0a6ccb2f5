"""Image formats of cameras and phones besides plain JPEG and PNG, and rotated photographs."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import ExifTags, Image

from pocketgs.capture import open_capture
from pocketgs.capture.depth_file import read_depth
from pocketgs.capture.image_file import read_colour, read_grey, read_header
from pocketgs.capture.open import lacks_poses, list_capture
from pocketgs.capture.photograph_copy import place_masks, place_photograph
from pocketgs.capture.unposed import find_photographs
from pocketgs.errors import PocketGSError
from pocketgs.structure_from_motion.images import source_masks

RAMP = np.add.outer(np.arange(0, 96, 2), np.arange(0, 128, 2)).astype(np.uint8)
PICTURE = np.dstack([RAMP, RAMP // 2 + 60, 255 - RAMP])


def on_its_side(orientation: int = 6) -> Image.Exif:
    """EXIF data; 6 asks for a quarter turn clockwise."""
    exif = Image.Exif()
    exif[ExifTags.Base.Orientation] = orientation
    exif[ExifTags.Base.Model] = "Phone"
    exif.get_ifd(ExifTags.IFD.Exif)[ExifTags.Base.FocalLengthIn35mmFilm] = 26
    return exif


@pytest.mark.parametrize("name", ["a.heic", "A.HEIF", "b.mpo", "c.jpg"])
def test_phones_formats(tmp_path, name):
    path, picture = tmp_path / name, Image.fromarray(PICTURE)
    if path.suffix in (".mpo", ".jpg"):
        other = Image.fromarray(PICTURE[:24, :32])
        picture.save(path, "MPO", save_all=True, append_images=[other], quality=95)
    else:
        pytest.importorskip("pillow_heif").register_heif_opener()
        picture.save(path, "HEIF", quality=95)
    colours, alpha = read_colour(path)
    assert (colours.shape, alpha) == (PICTURE.shape, None)
    assert np.abs(colours.astype(int) - PICTURE).mean() < 4
    assert (read_header(path).width, read_header(path).height) == (64, 48)
    assert [file.name for file in find_photographs(tmp_path)] == [name]
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 3])
    with pytest.raises(PocketGSError, match=r"cannot be decoded"):
        read_colour(path)


@pytest.mark.parametrize("suffix", [".png", ".tif"])
def test_sixteen_bits_are_scaled(tmp_path, suffix):
    path = tmp_path / f"a{suffix}"
    cv2.imwrite(str(path), cv2.cvtColor(PICTURE.astype(np.uint16) * 257, cv2.COLOR_RGB2BGR))
    np.testing.assert_array_equal(read_colour(path)[0], PICTURE)
    cv2.imwrite(str(path), RAMP.astype(np.uint16) * 257)
    np.testing.assert_array_equal(read_colour(path)[0][..., 1], RAMP)
    np.testing.assert_array_equal(read_grey(path, 1), RAMP)


def test_floating_point_pixels_are_refused(tmp_path):
    Image.fromarray(RAMP.astype(np.float32)).save(tmp_path / "a.tif")
    with pytest.raises(PocketGSError, match=r"a\.tif: .* expected 8 or 16 bits"):
        read_colour(tmp_path / "a.tif")


def test_stored_pixels_are_turned_only_for_cameras_of_the_turned_shape(ring, write_transforms):
    folder = write_transforms(w=12, h=16, cx=6.5, cy=8.5)
    for name, image in zip(ring.names, ring.images, strict=True):
        Image.fromarray(image).save(folder / "images" / name, exif=on_its_side())
    turned = list_capture(folder)
    assert turned.outline().largest == (12, 16)
    frame = next(frame for frame in turned.load().frames if frame.name == "images/view_03.png")
    np.testing.assert_array_equal(frame.image, np.rot90(ring.images[3], -1))
    assert (frame.camera.cx, frame.camera.width) == (6.5, 12)
    stored = open_capture(write_transforms())  # states the size of the stored pixels
    assert stored.train[0].image.shape == (12, 16, 3)


def test_photographs_without_poses_are_placed_upright(tmp_path):
    source, placed = tmp_path / "photos", tmp_path / "placed"
    source.mkdir()
    placed.mkdir()
    pictures = {"a.jpg": 1, "b.jpg": 6, "c.JPG": 3}
    for name, orientation in pictures.items():
        Image.fromarray(PICTURE).save(source / name, quality=95, exif=on_its_side(orientation))
    pytest.importorskip("pillow_heif").register_heif_opener()
    Image.fromarray(PICTURE).save(source / "d.heic")
    Image.fromarray(PICTURE).save(source / "a.heic")  # iPhones can keep both
    assert lacks_poses(source)
    found = {photograph: place_photograph(photograph, placed) for photograph in find_photographs(source)}
    sizes = {file.name: read_header(file) for file in found.values()}
    assert set(sizes) == {"a.jpg", "a.heic.jpg", "b.jpg", "c.JPG", "d.jpg"}
    assert (sizes["b.jpg"].width, sizes["b.jpg"].height) == (48, 64)
    assert all(header.orientation == 1 for header in sizes.values())
    exif = Image.open(placed / "b.jpg").getexif()
    assert exif[ExifTags.Base.Model] == "Phone"
    assert exif.get_ifd(ExifTags.IFD.Exif)[ExifTags.Base.FocalLengthIn35mmFilm] == 26
    assert np.abs(read_colour(placed / "c.JPG")[0].astype(int) - PICTURE[::-1, ::-1]).mean() < 4
    assert read_header(source / "b.jpg").orientation == 6
    assert source_masks(source, "found") == {}


def test_long_notes_in_exif_are_left_out(tmp_path: Path) -> None:
    """JPEG has room for 64 kB, PNG and HEIF have more."""
    exif = on_its_side()
    exif.get_ifd(ExifTags.IFD.Exif)[ExifTags.Base.MakerNote] = bytes(70_000)
    Image.fromarray(PICTURE).save(tmp_path / "a.png", exif=exif)
    (tmp_path / "placed").mkdir()
    stored = Image.open(place_photograph(tmp_path / "a.png", tmp_path / "placed"))
    assert stored.size == (48, 64)
    assert stored.getexif()[ExifTags.Base.Model] == "Phone"
    assert stored.getexif().get_ifd(ExifTags.IFD.Exif)[ExifTags.Base.FocalLengthIn35mmFilm] == 26


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
    found = {photograph: place_photograph(photograph, placed) for photograph in find_photographs(source)}
    place_masks(source_masks(source, "found"), found, tmp_path / "masks")
    for name in cases:
        stored = np.asarray(Image.open(tmp_path / f"masks/{name}.jpg.png"))
        np.testing.assert_array_equal(stored, np.rot90(half if name in "de" else mask, -1) > 0)


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
    found = {photograph: place_photograph(photograph, placed) for photograph in find_photographs(source)}
    place_masks(source_masks(source, "found"), found, tmp_path / "masks")
    for name, expected in upright.items():
        written = np.asarray(Image.open(tmp_path / f"masks/{name}.jpg.png"))
        np.testing.assert_array_equal(written, expected > 0, err_msg=name)


@pytest.mark.parametrize("channel", ["Z", "R", "Y"])
def test_openexr_depth(tmp_path: Path, channel: str) -> None:
    openexr = pytest.importorskip("OpenEXR")
    depth = np.linspace(0, 4, 48, dtype=np.float16).reshape(6, 8)
    depth[2, 3] = np.inf
    path = tmp_path / "a.exr"
    header = {"compression": openexr.ZIP_COMPRESSION, "type": openexr.scanlineimage}
    openexr.File(header, {channel: depth}).write(str(path))
    expected = np.where(np.isfinite(depth), depth, 0).astype(np.float32)
    np.testing.assert_array_equal(read_depth(path, 1.0), expected)
    whole = path.read_bytes()
    for kept in (0, 3, 100, len(whole) - 20):
        path.write_bytes(whole[:kept])
        with pytest.raises(PocketGSError, match=r"a\.exr: not a readable OpenEXR file"):
            read_depth(path, 1.0)
    with pytest.raises(PocketGSError, match=r"b\.exr: no such file"):
        read_depth(tmp_path / "b.exr", 1.0)
