"""Photographs of other colour profiles than sRGB, and profiles that say nothing."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageCms

from capture.photographs import PICTURE, RAMP, display_p3, on_its_side
from pocketgs.capture.decoding.image_file import read_colour
from pocketgs.capture.photograph_copy import place_photograph

SRGB = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()

P3_TO_SRGB = np.array([[1.2249, -0.2249, 0.0], [-0.0421, 1.0421, 0.0], [-0.0196, -0.0786, 1.0983]])
"""Of linear light (CSS Color 4, section 10.6)."""


def from_p3(levels: np.ndarray) -> np.ndarray:
    """(H, W, 3) levels of Display P3 in sRGB."""
    share = levels / 255
    linear = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    linear = np.clip(linear @ P3_TO_SRGB.T, 0, 1)
    return 255 * np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


@pytest.mark.parametrize("suffix", ["png", "tif", "webp", "jpg", "heic"])
def test_wide_colours_become_srgb(tmp_path: Path, suffix: str) -> None:
    if suffix == "heic":
        pytest.importorskip("pillow_heif").register_heif_opener()
    path = tmp_path / f"a.{suffix}"
    options = {"lossless": True} if suffix == "webp" else {"quality": 98} if suffix in ("jpg", "heic") else {}
    Image.fromarray(PICTURE).save(path, icc_profile=display_p3(), **options)
    off = np.abs(read_colour(path)[0] - from_p3(PICTURE))
    assert off.mean() < (2.0 if suffix in ("jpg", "heic") else 0.5)
    assert np.abs(PICTURE - from_p3(PICTURE)).mean() > 4


def test_alpha_and_turned_photographs(tmp_path: Path) -> None:
    alpha = np.full_like(RAMP, 200)
    cut_out = Image.fromarray(np.dstack([PICTURE, alpha]))
    cut_out.save(tmp_path / "a.png", icc_profile=display_p3(), exif=on_its_side())
    colours, found = read_colour(tmp_path / "a.png", upright=True)
    assert np.abs(colours - from_p3(np.rot90(PICTURE, -1))).max() <= 1.5
    np.testing.assert_array_equal(found, np.rot90(alpha, -1))


def test_copies_for_structure_from_motion_are_in_srgb(tmp_path: Path) -> None:
    Image.fromarray(PICTURE).save(tmp_path / "a.png", icc_profile=display_p3(), exif=on_its_side())
    place_photograph(tmp_path / "a.png", tmp_path / "b.jpg")
    assert np.abs(read_colour(tmp_path / "b.jpg")[0] - from_p3(np.rot90(PICTURE, -1))).mean() < 2


@pytest.mark.parametrize("mode", ["RGB", "L", "LA", "P", "1", "I;16", "CMYK"])
@pytest.mark.parametrize("profile", [SRGB, display_p3()[:300], b"none"], ids=["sRGB", "cut short", "none"])
def test_profiles_that_say_nothing_are_ignored(tmp_path: Path, mode: str, profile: bytes) -> None:
    image = Image.fromarray(RAMP.astype(np.uint16) * 257) if mode == "I;16" else Image.fromarray(PICTURE).convert(mode)
    image.save(tmp_path / "a.tif")
    image.save(tmp_path / "b.tif", icc_profile=profile)
    np.testing.assert_array_equal(read_colour(tmp_path / "b.tif")[0], read_colour(tmp_path / "a.tif")[0])


def test_profiles_of_grey_photographs(tmp_path: Path) -> None:
    grey = bytearray(SRGB.replace(struct.pack(">i", round(65536 * 2.4)), struct.pack(">i", 65536 * 2)))
    grey[16:20] = b"GRAY"
    curve = grey.index(b"rTRC")
    grey[curve : curve + 4] = b"kTRC"
    Image.fromarray(RAMP).save(tmp_path / "a.png", icc_profile=bytes(grey))
    brighter = 255 * (RAMP / 255) ** (2 / 2.4)
    middle = (RAMP > 60) & (RAMP < 200)
    assert np.abs(read_colour(tmp_path / "a.png")[0] - brighter[..., None])[middle].max() < 4
