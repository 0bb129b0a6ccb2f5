"""A picture, EXIF data that turn it, and a profile of its colours."""

from __future__ import annotations

import struct

import numpy as np
from PIL import ExifTags, Image, ImageCms

RAMP = np.add.outer(np.arange(0, 96, 2), np.arange(0, 128, 2)).astype(np.uint8)
PICTURE = np.dstack([RAMP, RAMP // 2 + 60, 255 - RAMP])


def on_its_side(orientation: int = 6) -> Image.Exif:
    """EXIF data; 6 asks for a quarter turn clockwise."""
    exif = Image.Exif()
    exif[ExifTags.Base.Orientation] = orientation
    exif[ExifTags.Base.Model] = "Phone"
    exif.get_ifd(ExifTags.IFD.Exif)[ExifTags.Base.FocalLengthIn35mmFilm] = 26
    return exif


P3_PRIMARIES = {
    b"rXYZ": (0.51512, 0.24120, -0.00105),
    b"gXYZ": (0.29198, 0.69225, 0.04189),
    b"bXYZ": (0.15710, 0.06657, 0.78407),
}
"""CIE XYZ of Display P3's red, green and blue, under the light that profiles refer to, D50."""


def display_p3() -> bytes:
    """The colour profile of iPhones' photographs: sRGB's curve, with stronger red, green and blue."""
    profile = bytearray(ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes())
    (tags,) = struct.unpack_from(">I", profile, 128)
    for name, place, _ in struct.iter_unpack(">4sII", bytes(profile[132 : 132 + 12 * tags])):
        if name in P3_PRIMARIES:
            # Behind the type and four empty bytes, in 1/65536.
            struct.pack_into(">3i", profile, place + 8, *(round(65536 * value) for value in P3_PRIMARIES[name]))
    return bytes(profile)
