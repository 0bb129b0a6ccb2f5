"""EXIF data about the camera and its position."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from PIL import Image
from PIL.ExifTags import GPS, IFD, Base

DIAGONAL_OF_35_MM = math.hypot(36.0, 24.0)
MILLIMETRES_PER_UNIT = {2: 25.4, 3: 10.0, 4: 1.0, 5: 0.001}
"""Millimetres per unit of EXIF's FocalPlaneResolutionUnit."""


@dataclass(frozen=True)
class Exif:
    """EXIF data that help to find poses; None where missing or implausible.

    Attributes:
        camera: make, model and focal length. Photographs of one size with the same value and the same `focal_ratio`
            share a camera.
        focal_ratio: focal length over the image's diagonal.
        place: latitude and longitude in degrees (WGS84) and altitude in metres.
    """

    camera: str = ""
    focal_ratio: float | None = None
    place: tuple[float, float, float] | None = None


def read_exif(image: Image.Image) -> Exif:
    """Read the EXIF data of an open image; never raises."""
    try:
        tags = image.getexif()
        details, gps = tags.get_ifd(IFD.Exif), tags.get_ifd(IFD.GPSInfo)
    except Exception:  # damaged EXIF data raise different types
        return Exif()
    names = [tags.get(Base.Make), tags.get(Base.Model), details.get(Base.LensModel), details.get(Base.FocalLength)]
    camera = " ".join(str(name).strip("\0 ") for name in names if name)
    return Exif(camera, _focal_ratio(details), _place(gps))


def _focal_ratio(details: dict[int, Any]) -> float | None:
    """From the 35 mm equivalent focal length, which is defined by the diagonal, else from the pixel pitch."""
    equivalent = _number(details.get(Base.FocalLengthIn35mmFilm))
    if equivalent is not None:
        ratio = equivalent / DIAGONAL_OF_35_MM
    else:
        focal, per_unit = _number(details.get(Base.FocalLength)), _number(details.get(Base.FocalPlaneXResolution))
        unit = MILLIMETRES_PER_UNIT.get(details.get(Base.FocalPlaneResolutionUnit, 2))
        stored = _number(details.get(Base.ExifImageWidth)), _number(details.get(Base.ExifImageHeight))
        if focal is None or per_unit is None or unit is None or None in stored:
            return None
        # The resolution refers to the size that EXIF states; the file may have been reduced since.
        ratio = focal * per_unit / unit / math.hypot(*(side for side in stored if side is not None))
    return ratio if 0.1 < ratio < 20 else None


def _place(gps: dict[int, Any]) -> tuple[float, float, float] | None:
    latitude = _degrees(gps.get(GPS.GPSLatitude), gps.get(GPS.GPSLatitudeRef), "S")
    longitude = _degrees(gps.get(GPS.GPSLongitude), gps.get(GPS.GPSLongitudeRef), "W")
    altitude = _number(gps.get(GPS.GPSAltitude), least=None)
    if latitude is None or longitude is None or altitude is None or latitude == longitude == 0:
        return None
    below = gps.get(GPS.GPSAltitudeRef) in (1, b"\x01")
    return latitude, longitude, -altitude if below else altitude


def _degrees(parts: Any, reference: Any, negative: str) -> float | None:
    """Degrees of (degrees, minutes, seconds)."""
    if not isinstance(parts, tuple) or len(parts) != 3:
        return None
    numbers = [_number(part, least=None) for part in parts]
    if any(number is None for number in numbers):
        return None
    degrees = sum((number or 0.0) / 60**place for place, number in enumerate(numbers))
    if not 0 <= degrees <= 180:
        return None
    return -degrees if str(reference).strip("\0 ").upper() == negative else degrees


def _number(value: Any, least: float | None = 0.0) -> float | None:
    """A finite number above `least`, or None."""
    try:
        number = float(value)
    except (TypeError, ValueError, ZeroDivisionError):
        return None
    return number if math.isfinite(number) and (least is None or number > least) else None
