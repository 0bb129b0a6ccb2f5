"""A picture, and EXIF data that turn it."""

from __future__ import annotations

import numpy as np
from PIL import ExifTags, Image

RAMP = np.add.outer(np.arange(0, 96, 2), np.arange(0, 128, 2)).astype(np.uint8)
PICTURE = np.dstack([RAMP, RAMP // 2 + 60, 255 - RAMP])


def on_its_side(orientation: int = 6) -> Image.Exif:
    """EXIF data; 6 asks for a quarter turn clockwise."""
    exif = Image.Exif()
    exif[ExifTags.Base.Orientation] = orientation
    exif[ExifTags.Base.Model] = "Phone"
    exif.get_ifd(ExifTags.IFD.Exif)[ExifTags.Base.FocalLengthIn35mmFilm] = 26
    return exif
