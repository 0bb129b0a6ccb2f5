"""Photographs are decoded as Python decodes them: as stored, unless their camera has the shape of the turned image."""

from __future__ import annotations

import base64
import hashlib
import io
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image, ImageCms, PngImagePlugin
from playwright.sync_api import Error

from pocketgs.capture.decoding.image_file import read_colour
from pocketgs.capture.listing import FrameSource
from pocketgs.capture.loading import Preparation, load_frame
from pocketgs.geometry.camera import Camera
from pocketgs.geometry.lens import Lens

Call = Callable[..., Any]

LOAD = """
    const {StoredFile} = await import(new URL("archive/tree.js", location.href));
    const bytes = Uint8Array.from(atob(given.content), (character) => character.charCodeAt(0));
    const file = new StoredFile(given.name, bytes.length, async () => bytes);
    const {sourceOf} = await import(new URL("capture/listing.js", location.href));
    const maskBytes = given.mask && Uint8Array.from(atob(given.mask), (character) => character.charCodeAt(0));
    const mask = maskBytes && new StoredFile("mask.png", maskBytes.length, async () => maskBytes);
    const depthBytes = given.depth && Uint8Array.from(atob(given.depth), (character) => character.charCodeAt(0));
    const depthFile = depthBytes && new StoredFile("depth.png", depthBytes.length, async () => depthBytes);
    const depth = depthFile && {file: depthFile, unit: 0.001, confidence: null};
    const source = sourceOf(file, given.camera, {lens: given.lens, border: given.border, mask, depth});
    const pixels = await module.decodedPhotograph(source, settings.capture);
    const found = await module.prepared(source, pixels, [1, 1, 1], given.most, settings.capture);
    const listed = (values) => values && [...values];
    return {...found, rgba: listed(found.rgba), mask: listed(found.mask), depth: listed(found.depth)};
"""

TURNED_RIGHT = 6


def smooth(height: int, width: int, channels: int = 3) -> np.ndarray:
    """An image that JPEG and premultiplied alpha leave nearly as it is."""
    rows, columns, channel = np.mgrid[:height, :width, :channels]
    return (128 + 100 * np.sin(rows / 7 + channel) * np.cos(columns / 9 - channel)).astype(np.uint8)


def encoded(image: np.ndarray, suffix: str, orientation: int = 1) -> bytes:
    exif = Image.Exif()
    exif[0x0112] = orientation
    stream = io.BytesIO()
    Image.fromarray(image).save(stream, suffix, quality=95, exif=exif)
    return stream.getvalue()


def load(
    call: Call,
    content: bytes,
    camera: Camera,
    lens: Lens,
    most: int,
    border: int = 0,
    mask: bytes | None = None,
    depth: bytes | None = None,
) -> dict[str, Any]:
    numbers = {name: getattr(camera, name) for name in ("width", "height", "fx", "fy", "cx", "cy")}
    coefficients = [*lens.coefficients, *[0.0] * 8][:8]
    given = {
        "content": base64.b64encode(content).decode(),
        "name": "photograph",
        "camera": {**numbers, "world_to_camera": np.eye(4).reshape(-1).tolist()},
        "lens": {"model": lens.model, "coefficients": coefficients},
        "most": most,
        "border": border,
        "mask": None if mask is None else base64.b64encode(mask).decode(),
        "depth": None if depth is None else base64.b64encode(depth).decode(),
    }
    return call("capture/photograph.js", LOAD, given)


LANDSCAPE = Camera(80, 60, 70.0, 70.0, 41.0, 29.0, np.eye(4))
PORTRAIT = Camera(60, 80, 70.0, 70.0, 29.0, 41.0, np.eye(4))


@pytest.mark.parametrize(
    ("suffix", "orientation", "channels", "camera", "lens", "most"),
    [
        ("png", 1, 3, LANDSCAPE, Lens(), 800),
        ("png", 1, 4, LANDSCAPE, Lens(), 40),
        ("jpeg", 1, 3, LANDSCAPE, Lens(), 40),
        ("jpeg", TURNED_RIGHT, 3, LANDSCAPE, Lens(), 800),
        ("jpeg", TURNED_RIGHT, 3, PORTRAIT, Lens(), 800),
        ("jpeg", 1, 3, replace(LANDSCAPE, width=160, height=120, fx=140.0), Lens("opencv", (0.1, 0, 0, 0)), 50),
    ],
    ids=["as it is", "transparent", "smaller", "stored turned", "camera of the turned image", "lens"],
)
def test_as_in_python(
    call: Call,
    tmp_path: Path,
    suffix: str,
    orientation: int,
    channels: int,
    camera: Camera,
    lens: Lens,
    most: int,
) -> None:
    content = encoded(smooth(60, 80, channels), suffix, orientation)
    path = tmp_path / f"photograph.{suffix}"
    path.write_bytes(content)
    expected = load_frame(FrameSource("photograph", path, camera, lens), Preparation((1.0, 1.0, 1.0), max_size=most))
    found = load(call, content, camera, lens, most)
    numbers = ("width", "height", "fx", "fy", "cx", "cy")
    assert [found["camera"][name] for name in numbers] == pytest.approx([getattr(expected.camera, n) for n in numbers])
    rgba = np.reshape(found["rgba"], (*expected.image.shape[:2], 4))
    off = np.abs(rgba[..., :3] - expected.image.astype(int))
    assert off.max() <= 4
    assert off.mean() < 0.5
    assert found["hasAlpha"] == (expected.alpha is not None)
    if expected.alpha is not None:
        assert np.abs(rgba[..., 3] - expected.alpha.astype(int)).max() <= 1


LARGE = """
    const bytes = Uint8Array.from(atob(given), (character) => character.charCodeAt(0));
    const read = OffscreenCanvasRenderingContext2D.prototype.getImageData;
    const canvases = new Set();
    let most = 0;
    OffscreenCanvasRenderingContext2D.prototype.getImageData = function (...place) {
        canvases.add(this.canvas);
        most = Math.max(most, this.canvas.width * this.canvas.height);
        return read.apply(this, place);
    };
    const {rgba} = await module.decoded(bytes, "image/png", "large.png");
    OffscreenCanvasRenderingContext2D.prototype.getImageData = read;
    const left = [...canvases].reduce((sum, {width, height}) => sum + width * height, 0);
    const hash = new Uint8Array(await crypto.subtle.digest("SHA-256", rgba));
    return [most, left, [...hash]];
"""


def test_large_photographs_need_no_large_canvas(call: Call) -> None:
    """Safari on iOS refuses such, and frees those late that are not emptied."""
    image = np.dstack([smooth(1700, 2600), np.full((1700, 2600), 255, np.uint8)])
    most, left, digest = call("capture/pixels.js", LARGE, base64.b64encode(encoded(image, "png")).decode())
    assert most <= 1 << 22 < image[..., 0].size
    assert left == 0
    assert bytes(digest) == hashlib.sha256(image.tobytes()).digest()


@pytest.mark.parametrize("most", [40, 20, 10])
def test_averages_are_rounded_as_in_python(call: Call, tmp_path: Path, most: int) -> None:
    """Most averages of four pixels are halves or wholes."""
    content = encoded(np.random.default_rng(0).integers(0, 256, (60, 80, 3), np.uint8), "png")
    path = tmp_path / "photograph.png"
    path.write_bytes(content)
    expected = load_frame(FrameSource("photograph", path, LANDSCAPE), Preparation((1.0, 1.0, 1.0), max_size=most))
    found = load(call, content, LANDSCAPE, Lens(), most)
    rgba = np.reshape(found["rgba"], (*expected.image.shape[:2], 4))
    np.testing.assert_array_equal(rgba[..., :3], expected.image)


def spots(height: int, width: int) -> np.ndarray:
    return smooth(height, width, 1)[..., 0] > 128


PALETTE = Image.fromarray(spots(60, 80).astype(np.uint8) * 3, "P")
PALETTE.putpalette([0, 0, 0, 9, 9, 9, 80, 0, 0, 0, 30, 60])
CUT_OUT = np.dstack([np.full((60, 80, 3), 9, np.uint8), spots(60, 80).astype(np.uint8) * 255])
MASKS: dict[str, Image.Image] = {
    "grey": Image.fromarray(smooth(60, 80, 1)[..., 0]),
    "ones": Image.fromarray(spots(60, 80).astype(np.uint8)),
    "one bit": Image.fromarray(spots(60, 80)),
    "palette": PALETTE,
    "colour": Image.fromarray(np.where(smooth(60, 80) > 160, 255, 60).astype(np.uint8)),
    "cut out": Image.fromarray(CUT_OUT),
    "smaller": Image.fromarray(smooth(15, 20, 1)[..., 0]),
}


@pytest.mark.parametrize("kind", MASKS)
@pytest.mark.parametrize(
    ("lens", "border", "most"), [(Lens(), 7, 800), (Lens("opencv", (0.1, 0, 0, 0)), 0, 40)], ids=["border", "lens"]
)
def test_masks_as_in_python(call: Call, tmp_path: Path, kind: str, lens: Lens, border: int, most: int) -> None:
    content, stream = encoded(smooth(60, 80), "png"), io.BytesIO()
    MASKS[kind].save(stream, "png")
    path, mask_path = tmp_path / "photograph.png", tmp_path / "mask.png"
    path.write_bytes(content)
    mask_path.write_bytes(stream.getvalue())
    source = FrameSource("photograph", path, LANDSCAPE, lens, mask_path=mask_path, border=border)
    expected = load_frame(source, Preparation((1.0, 1.0, 1.0), max_size=most))
    found = load(call, content, LANDSCAPE, lens, most, border, stream.getvalue())
    assert [found["camera"][name] for name in ("width", "height", "cx", "cy")] == pytest.approx(
        [getattr(expected.camera, name) for name in ("width", "height", "cx", "cy")]
    )
    assert expected.mask is not None
    mask = np.reshape(found["mask"], expected.mask.shape)
    assert set(np.unique(mask)) == {0, 255}
    assert np.mean((mask > 0) != expected.mask) < 0.005  # OpenCV rounds coordinates to 1/32 pixel


@pytest.mark.parametrize(
    ("lens", "border", "most"),
    [(Lens(), 0, 800), (Lens(), 7, 40), (Lens("opencv", (0.1, 0, 0, 0)), 0, 40)],
    ids=["as it is", "border", "lens"],
)
def test_depth_as_in_python(call: Call, tmp_path: Path, lens: Lens, border: int, most: int) -> None:
    content, stream = encoded(smooth(60, 80), "png"), io.BytesIO()
    Image.fromarray(np.random.default_rng(0).integers(0, 65536, (24, 32), np.uint16)).save(stream, "png")
    path, depth_path = tmp_path / "photograph.png", tmp_path / "depth.png"
    path.write_bytes(content)
    depth_path.write_bytes(stream.getvalue())
    source = FrameSource("photograph", path, LANDSCAPE, lens, depth_path=depth_path, border=border)
    expected = load_frame(source, Preparation((1.0, 1.0, 1.0), max_size=most)).depth
    found = load(call, content, LANDSCAPE, lens, most, border, depth=stream.getvalue())
    assert expected is not None
    off = np.reshape(found["depth"], expected.shape) != expected
    assert np.mean(off) < (0.02 if lens.distorts else 1e-9)  # OpenCV rounds coordinates to 1/32 pixel


def test_bytes_that_fill(call: Call) -> None:
    """Any number of 0xff may stand before a segment of a JPEG."""
    content = encoded(smooth(60, 80), "jpeg", TURNED_RIGHT)
    filled = content.replace(b"\xff\xc0", b"\xff" * 4 + b"\xc0").replace(b"\xff\xe1", b"\xff\xff\xe1")
    expected, found = (load(call, each, LANDSCAPE, Lens(), 800) for each in (content, filled))
    assert found["rgba"] == expected["rgba"]


def test_depth_of_another_shape_is_left_out(call: Call) -> None:
    stream = io.BytesIO()
    Image.fromarray(np.full((32, 24), 1000, np.uint16)).save(stream, "png")
    found = load(call, encoded(smooth(60, 80), "png"), LANDSCAPE, Lens(), 800, depth=stream.getvalue())
    assert found["depth"] is None


def test_a_mask_of_another_shape(call: Call) -> None:
    mask = encoded(smooth(60, 60), "png")
    with pytest.raises(Error, match=r"mask\.png: mask of 60x60 pixels, expected the shape of its photograph, 80x60"):
        load(call, encoded(smooth(60, 80), "png"), LANDSCAPE, Lens(), 800, mask=mask)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "not a whole JPEG or PNG image"),
        (b"GIF89a" + bytes(100), "not a whole JPEG or PNG image"),
        (encoded(smooth(60, 80), "png")[:20], "not a whole JPEG or PNG image"),
        (encoded(smooth(60, 80), "png")[:300], "cannot be decoded"),
        (encoded(smooth(60, 80), "jpeg")[:30], "not a whole JPEG or PNG image"),
        (encoded(smooth(60, 80), "png")[:16] + b"\x00\x01\x00\x00" * 2 + bytes(90), "65536x65536 pixels, expected at"),
        (encoded(smooth(60, 60), "png"), "image of 60x60 pixels, expected the shape of its camera, 80x60"),
    ],
)
def test_what_is_no_photograph(call: Call, content: bytes, words: str) -> None:
    with pytest.raises(Error, match=words):
        load(call, content, LANDSCAPE, Lens(), 800)


COLOURS = """
    const {drawn} = await import(new URL("capture/pixels.js", location.href));
    const bytes = Uint8Array.from(atob(given), (character) => character.charCodeAt(0));
    const {plain, coloured, turnable, type} = module.readHeader(bytes, "photograph");
    const shown = [];
    for (const content of [bytes, plain, coloured, turnable]) {
        const bitmap = await createImageBitmap(new Blob([content], {type}));
        shown.push([bitmap.width, [...drawn(bitmap, bitmap.width, bitmap.height).rgba.slice(0, 3)]]);
    }
    return shown;
"""


@pytest.mark.parametrize(("suffix", "by"), [("JPEG", "profile"), ("PNG", "profile"), ("PNG", "gamma")])
def test_only_profiles_change_the_colours_of_photographs(call: Call, tmp_path: Path, suffix: str, by: str) -> None:
    """Without its profile or gamma a file has nothing by which a browser could change its colours."""
    profile = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    for one, other in ((b"rXYZ", b"swap"), (b"bXYZ", b"rXYZ"), (b"swap", b"bXYZ")):
        profile = profile.replace(one, other)
    chunks = PngImagePlugin.PngInfo()
    chunks.add(b"gAMA", (100_000).to_bytes(4, "big"))
    more: dict[str, Any] = {"icc_profile": profile} if by == "profile" else {"pnginfo": chunks}
    exif = Image.Exif()
    exif[0x0112] = TURNED_RIGHT
    path = tmp_path / "photograph"
    Image.new("RGB", (24, 16), (200, 120, 40)).save(path, suffix, quality=95, exif=exif, **more)
    content = base64.b64encode(path.read_bytes()).decode()
    stored, plain, coloured, turnable = call("capture/image_header.js", COLOURS, content)
    assert np.abs(np.subtract(stored[1], (200, 120, 40))).max() > 20
    assert np.abs(np.subtract(plain[1], (200, 120, 40))).max() <= 2
    assert np.abs(np.subtract(coloured[1], read_colour(path)[0][0, 0].astype(int))).max() <= 2
    assert turnable[1] == coloured[1]
    assert (plain[0], coloured[0], turnable[0]) == (24, 24, stored[0])
