"""Reader of mask images: white for pixels to use, black for pixels to ignore."""

from __future__ import annotations

import numpy as np
from PIL import Image, ImageOps

from pocketgs.capture.decoding.image_file import SIXTEEN_BIT_MODES, high_bytes, read_image
from pocketgs.files.opening import CaptureFile

HALF, WHITE = 127, 255


def read_mask(path: CaptureFile, upright: bool = False) -> np.ndarray:
    """Read a mask as (H, W) bool, True for pixels to use.

    Pixels are used from half-way to white upwards: edges are often smoothed, and JPEG leaves noise on black. Masks of
    zeros and ones also work, and so do palette images from segmentation tools: there everything but black is used. Of a
    colour its brightest channel counts: pure red is used. If a mask has alpha, transparent pixels are not used.

    Args:
        path: the file.
        upright: apply the orientation in the mask's own EXIF, if it has any; otherwise pixels are as stored.

    Raises:
        PocketGSError: the file is missing, truncated, damaged or far too large.
    """
    return read_image(path, lambda image: _usable(ImageOps.exif_transpose(image) if upright else image))


def _usable(image: Image.Image) -> np.ndarray:
    if image.mode == "1":
        return np.asarray(image)
    if image.mode in SIXTEEN_BIT_MODES:
        values = np.asarray(image)
        # Some programs write the values of 8 bits as 16.
        return _bright(values if values.max() <= WHITE else high_bytes(image))
    if image.mode == "P" and "transparency" not in image.info:
        return np.asarray(image.convert("RGB")).max(axis=2) > 0
    if image.mode in ("RGBA", "LA", "PA", "P"):
        colours = np.asarray(image.convert("RGBA"))
        brightness, alpha = colours[:, :, :3].max(axis=2), colours[:, :, 3]
        # A cut-out in one colour is described by its alpha alone.
        cut_out = brightness.min() == brightness.max() and alpha.min() < alpha.max()
        return (alpha > HALF) & (_bright(brightness) | cut_out)
    if image.mode in ("L", "F"):
        return _bright(np.asarray(image.convert("L")))
    return _bright(np.asarray(image.convert("RGB")).max(axis=2))


def _bright(values: np.ndarray) -> np.ndarray:
    return values > (0 if values.max() <= 1 else HALF)
