"""Masks as image files: white where a photograph's pixels are to be used, black where they are not."""

from __future__ import annotations

import numpy as np
from PIL import Image

from pocketgs.capture.image_file import SIXTEEN_BIT_MODES, high_bytes, read_image
from pocketgs.files.paths import CaptureFile

HALF = 127


def read_mask(path: CaptureFile) -> np.ndarray:
    """(H, W) bool, True where a photograph's pixels are to be used.

    That is where the mask is white, or half way to it at least: edges are often smoothed, and JPEG leaves noise on
    black. Masks of zeros and ones count too, and so do coloured ones with a palette, as segmentation tools write them:
    there, everything that is not black. Where a mask has alpha, transparent pixels are not to be used.

    Raises:
        PocketGSError: the file is missing, truncated, damaged or far too large.
    """
    return read_image(path, _usable)


def _usable(image: Image.Image) -> np.ndarray:
    if image.mode == "1":
        return np.asarray(image)
    if image.mode in SIXTEEN_BIT_MODES:
        values = np.asarray(image)
        return values > 0 if values.max() <= 1 else high_bytes(image) > HALF
    if image.mode == "P" and "transparency" not in image.info:
        return np.asarray(image.convert("RGB")).max(axis=2) > 0
    if image.mode in ("RGBA", "LA", "PA", "P"):
        brightness, alpha = np.asarray(image.convert("RGBA").convert("LA")).transpose(2, 0, 1)
        # A cut-out of one colour says nothing but by its alpha.
        return (alpha > HALF) & (_bright(brightness) | (brightness.min() == brightness.max()))
    return _bright(np.asarray(image.convert("L")))


def _bright(values: np.ndarray) -> np.ndarray:
    return values > (0 if values.max() <= 1 else HALF)
