"""Colour profiles: photographs brought to sRGB, the colours that scenes are trained in and shown in.

Phones store Display P3, and some cameras Adobe RGB. Their numbers taken as sRGB's would give pale colours.
"""

from __future__ import annotations

import io
from functools import lru_cache

import numpy as np
from PIL import Image, ImageCms

SRGB_TOLERANCE = 1
"""Levels by which a profile may differ from sRGB and count as it: there are many, rounded differently."""

TESTED_LEVELS = 18
"""Levels of each colour at which a profile is compared with sRGB."""


def in_srgb(image: Image.Image) -> Image.Image:
    """An RGB, RGBA, grey or CMYK image in sRGB, as its embedded profile says.

    It stays as it is if it has no profile, sRGB's, or one that is damaged or of another kind of image. RGB and RGBA
    images are changed in place, since photographs are large; others become RGB.
    """
    transform = _to_srgb(image.info.get("icc_profile"), image.mode)
    if transform is None:
        return image
    in_place = image.mode in ("RGB", "RGBA")
    return ImageCms.applyTransform(image, transform, inPlace=in_place) or image


@lru_cache(maxsize=4)
def _to_srgb(profile: bytes | None, mode: str) -> ImageCms.ImageCmsTransform | None:
    """What brings images of a mode to sRGB; None if nothing has to be done, or can be. Threads may share it."""
    if not profile:
        return None
    try:
        stated, srgb = ImageCms.ImageCmsProfile(io.BytesIO(profile)), ImageCms.createProfile("sRGB")
        transform = ImageCms.buildTransform(stated, srgb, mode, "RGBA" if mode == "RGBA" else "RGB")
    except (OSError, ImageCms.PyCMSError):
        return None
    return None if mode in ("RGB", "RGBA") and _changes_nothing(transform, mode) else transform


def _changes_nothing(transform: ImageCms.ImageCmsTransform, mode: str) -> bool:
    """Whether a transform leaves RGB or RGBA colours as they are, but for rounding."""
    levels = np.linspace(0, 255, TESTED_LEVELS).astype(np.uint8)
    colours = np.stack(np.meshgrid(levels, levels, levels), axis=-1).reshape(1, -1, 3)
    image = Image.fromarray(colours).convert(mode)
    changed = np.asarray(ImageCms.applyTransform(image, transform))[..., :3]
    return int(np.abs(changed.astype(int) - colours).max()) <= SRGB_TOLERANCE
