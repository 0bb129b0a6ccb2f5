"""Photographs of an object before one plain colour tell the background."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from capture.conftest import Ring
from pocketgs.capture import Frame, open_capture
from pocketgs.capture.plain_background import plain_background
from pocketgs.geometry.camera import Camera

CAMERA = Camera(40, 30, 50.0, 50.0, 20.0, 15.0, np.eye(4))


def cut_outs(colour: tuple[int, int, int], *, noise: int = 2, count: int = 4) -> list[Frame]:
    """Photographs of something coloured before a colour, which JPEG has changed a little."""
    random = np.random.default_rng(3)
    images = np.broadcast_to(np.array(colour), (count, 30, 40, 3)) + random.integers(
        -noise, noise + 1, (count, 30, 40, 3)
    )
    images[:, 8:22, 10:28] = random.integers(0, 256, (count, 14, 18, 3))
    return [Frame(str(index), CAMERA, image.clip(0, 255).astype(np.uint8)) for index, image in enumerate(images)]


@pytest.mark.parametrize("colour", [(255, 255, 255), (0, 0, 0), (90, 128, 40)])
def test_the_colour_at_the_edges(colour: tuple[int, int, int]) -> None:
    found = plain_background(cut_outs(colour))
    assert found is not None
    np.testing.assert_allclose(found, np.array(colour) / 255, atol=1.01 / 255)


def test_an_object_may_reach_the_edge() -> None:
    frames = cut_outs((255, 255, 255), noise=0)
    for frame in frames:
        frame.image[8:, 10:24] = 77
    assert plain_background(frames) == (1.0, 1.0, 1.0)


def test_a_white_sky_is_no_background() -> None:
    frames = cut_outs((255, 255, 255), noise=0)
    for frame in frames:
        frame.image[15:] = np.random.default_rng(1).integers(0, 256, (15, 40, 3))
    assert plain_background(frames) is None


def test_walls_differ_from_photograph_to_photograph() -> None:
    assert plain_background([*cut_outs((255, 255, 255), count=3), *cut_outs((245, 245, 245), count=3)]) is None


def test_alpha_tells_the_background_itself() -> None:
    first, *others = cut_outs((255, 255, 255))
    assert plain_background([replace(first, alpha=np.full((30, 40), 255, np.uint8)), *others]) is None


def test_masked_pixels_do_not_count() -> None:
    frames = [replace(frame, mask=np.zeros((30, 40), dtype=bool)) for frame in cut_outs((0, 0, 255))]
    assert plain_background(frames) is None
    for frame in frames:
        assert frame.mask is not None
        frame.image[0] = 31
        frame.mask[0] = True
    assert plain_background(frames) == pytest.approx((31 / 255,) * 3)


@pytest.fixture
def folder(ring: Ring, write_transforms: Callable[..., Path]) -> Path:
    written: Path = write_transforms()
    for frame, path in zip(cut_outs((255, 255, 255), count=10), sorted((written / "images").iterdir()), strict=True):
        Image.fromarray(frame.image).resize((16, 12), Image.Resampling.NEAREST).save(path)
    return written


@pytest.mark.parametrize("stated", [None, (0.0, 0.0, 0.0)])
def test_captures_have_it_unless_another_is_stated(folder: Path, stated: Any) -> None:
    capture = open_capture(folder, background=stated)
    if stated is None:
        assert capture.background == pytest.approx((1.0, 1.0, 1.0), abs=1.01 / 255)
        assert "16x12, on " in capture.protocol
    else:
        assert capture.background == stated
        assert capture.protocol == "16x12, held out every 8th by name"


def test_the_protocol_is_that_of_the_same_background_stated(folder: Path) -> None:
    capture = open_capture(folder)
    assert open_capture(folder, background=capture.background).protocol == capture.protocol
