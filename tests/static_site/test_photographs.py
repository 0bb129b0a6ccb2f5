"""Photographs are decoded as Python decodes them: as stored, unless their camera has the shape of the turned image."""

from __future__ import annotations

import base64
import io
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import Error

from pocketgs.capture.listing import FrameSource
from pocketgs.capture.loading import Preparation, load_frame
from pocketgs.geometry.camera import Camera
from pocketgs.geometry.lens import Lens

Call = Callable[..., Any]

LOAD = """
    const {StoredFile} = await import(new URL("archive/tree.js", location.href));
    const bytes = Uint8Array.from(atob(given.content), (character) => character.charCodeAt(0));
    const file = new StoredFile(given.name, bytes.length, async () => bytes);
    const source = {name: given.name, file, camera: given.camera, lens: given.lens};
    const {camera, rgba, hasAlpha} = await module.loadPhotograph(source, [1, 1, 1], given.most, settings.capture);
    return {camera, rgba: [...rgba], hasAlpha};
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


def load(call: Call, content: bytes, camera: Camera, lens: Lens, most: int) -> dict[str, Any]:
    numbers = {name: getattr(camera, name) for name in ("width", "height", "fx", "fy", "cx", "cy")}
    coefficients = [*lens.coefficients, *[0.0] * 8][:8]
    given = {
        "content": base64.b64encode(content).decode(),
        "name": "photograph",
        "camera": {**numbers, "world_to_camera": np.eye(4).reshape(-1).tolist()},
        "lens": {"model": lens.model, "coefficients": coefficients},
        "most": most,
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
