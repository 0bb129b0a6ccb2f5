"""Image formats of cameras and phones besides plain JPEG and PNG, and rotated photographs."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import ExifTags, Image

from capture.photographs import PICTURE, RAMP, on_its_side
from pocketgs.capture import open_capture
from pocketgs.capture.decoding.depth_file import read_depth
from pocketgs.capture.decoding.image_file import read_colour, read_grey, read_header, read_size
from pocketgs.capture.open import list_capture
from pocketgs.capture.unposed import find_photographs
from pocketgs.errors import PocketGSError


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


@pytest.mark.parametrize("mode", ["RGBA", "LA"])
def test_alpha_that_is_opaque_counts_as_none(tmp_path: Path, mode: str) -> None:
    alpha = Image.new("L", (64, 48), 255)
    picture = Image.fromarray(PICTURE).convert(mode)
    for lowest in (255, 254):
        alpha.putpixel((5, 7), lowest)
        picture.putalpha(alpha)
        picture.save(tmp_path / "a.png")
        found = read_colour(tmp_path / "a.png")[1]
        assert (found is None) == (lowest == 255)


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


@pytest.mark.parametrize("orientation", range(1, 9))
def test_tiff_is_turned_only_where_others_are(tmp_path: Path, orientation: int) -> None:
    """Pillow turns it by itself, unlike other formats."""
    exif = Image.Exif()
    exif[ExifTags.Base.Orientation] = orientation
    for name in ("a.tif", "a.png"):
        Image.fromarray(PICTURE).save(tmp_path / name, exif=exif)
    headers = [read_header(tmp_path / name) for name in ("a.tif", "a.png")]
    assert [(header.width, header.height, header.orientation) for header in headers] == [(64, 48, orientation)] * 2
    assert read_size(tmp_path / "a.tif") == (64, 48)
    np.testing.assert_array_equal(read_colour(tmp_path / "a.tif")[0], PICTURE)
    upright = [read_colour(tmp_path / name, upright=True)[0] for name in ("a.tif", "a.png")]
    np.testing.assert_array_equal(*upright)
    Image.fromarray(RAMP.astype(np.uint16) * 257).save(tmp_path / "depth.tif", exif=exif)
    np.testing.assert_array_equal(read_depth(tmp_path / "depth.tif", 1 / 257).round(), RAMP)


@pytest.mark.parametrize(
    "names", ["R G B A", "Combined.R Combined.G Combined.B Combined.A Depth.Z", "A V", "Z Y", "a.A a.V"]
)
def test_the_channel_of_openexr_that_is_depth(tmp_path: Path, names: str) -> None:
    openexr = pytest.importorskip("OpenEXR")
    depth = np.linspace(1, 4, 48, dtype=np.float32).reshape(6, 8)
    stated = {name: np.ones_like(depth) if name[-1] in "A" or "Combined" in name else depth for name in names.split()}
    stated |= {"Y": np.zeros_like(depth)} if "Y" in stated else {}
    header = {"compression": openexr.ZIP_COMPRESSION, "type": openexr.scanlineimage}
    openexr.File(header, stated).write(str(tmp_path / "a.exr"))
    np.testing.assert_array_equal(read_depth(tmp_path / "a.exr", 1.0), depth)


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
