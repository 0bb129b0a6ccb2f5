"""Reader of image files. Images are as stored unless the caller asks for EXIF's orientation to be applied."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TypeVar

import numpy as np
from PIL import ExifTags, Image, ImageOps, TiffImagePlugin

from pocketgs.capture.decoding.colour_profile import in_srgb
from pocketgs.errors import PocketGSError, clipped
from pocketgs.files.memory_bound import require_memory
from pocketgs.files.opening import CaptureFile, checked, open_file

Result = TypeVar("Result")

# Pillow's own warnings about image size; sizes are checked here.
warnings.filterwarnings("ignore", module=r"PIL\.")

MOST_PIXELS = 250_000_000
"""Room for the largest photographs of phones, 16320x12240 pixels. The memory bound alone is not enough: Pillow decodes
some files as it opens them, or decodes more than their headers state.
"""

Image.MAX_IMAGE_PIXELS = MOST_PIXELS // 2  # Pillow warns from here, and refuses twice as many

SIXTEEN_BIT_MODES = ("I", "I;16", "I;16B", "I;16L", "I;16N")
HEIF_MARK = b"ftyp"
"""Bytes 4 to 8 of a HEIF file. iPhones' photographs are often stored under the name .JPG."""

DECODING, DECODING_ALPHA = 24, 40
"""Bytes per pixel while a photograph is read, without and with alpha."""

OPAQUE = 255

UPRIGHT, QUARTER_TURNS = 1, (5, 6, 7, 8)  # values of EXIF's tag Orientation
TURNS_BACK = {
    2: Image.Transpose.FLIP_LEFT_RIGHT,
    3: Image.Transpose.ROTATE_180,
    4: Image.Transpose.FLIP_TOP_BOTTOM,
    5: Image.Transpose.TRANSPOSE,
    6: Image.Transpose.ROTATE_90,
    7: Image.Transpose.TRANSVERSE,
    8: Image.Transpose.ROTATE_270,
}
"""What undoes the turn that a value of Orientation asks for."""


class UndecodableImageError(PocketGSError):
    """A file is not an image, or a damaged one, such as one whose transfer was interrupted."""


@dataclass(frozen=True)
class ImageHeader:
    """The header of an image file.

    Attributes:
        width, height: in pixels, as stored.
        has_alpha: whether the pixels have alpha, be it opaque.
        orientation: EXIF's tag Orientation; 1 means upright.
        format: Pillow's name of the file's format, whatever its suffix.
    """

    width: int
    height: int
    has_alpha: bool
    orientation: int = UPRIGHT
    format: str = ""

    @property
    def upright_size(self) -> tuple[int, int]:
        """Width and height after applying EXIF's orientation."""
        turned = self.orientation in QUARTER_TURNS
        return (self.height, self.width) if turned else (self.width, self.height)


def read_header(path: CaptureFile) -> ImageHeader:
    """Read the header of an image file without decoding pixels.

    Raises:
        PocketGSError: the file is missing or not an image.
    """
    return _opened(path, _header)


def read_size(path: CaptureFile) -> tuple[int, int]:
    """Read the width and height of an image file from its header.

    Raises:
        PocketGSError: the file is missing or not an image.
    """
    return _opened(path, _stored_size)


def read_colour(path: CaptureFile, upright: bool = False) -> tuple[np.ndarray, np.ndarray | None]:
    """Read the colours of an image file, and its alpha if any pixel is not opaque.

    Of a file with several images, such as those of cameras with two lenses, the first is read. 16 bits become 8, and
    colours of other profiles, such as Display P3, become sRGB.

    Args:
        path: the file.
        upright: apply EXIF's orientation; otherwise pixels are as stored.

    Returns:
        (H, W, 3) uint8 RGB and (H, W) uint8 alpha or None.

    Raises:
        PocketGSError: the file is missing, truncated, damaged or far too large.
    """
    return read_image(path, lambda image: colour_and_alpha(ImageOps.exif_transpose(image) if upright else image))


def read_image(path: CaptureFile, read: Callable[[Image.Image], Result]) -> Result:
    """Apply a function to an image that Pillow has opened, its pixels as stored, after checking the memory bound.

    Raises:
        PocketGSError: as `read_colour`, or the function failed; the message names the file.
    """

    def bounded(image: Image.Image) -> Result:
        pixel_bytes = DECODING_ALPHA if _has_alpha(image) else DECODING
        require_memory(path, pixel_bytes * image.width * image.height, f"{image.width}x{image.height} pixels")
        return read(_as_stored(image))

    return _opened(path, bounded)


def read_grey(path: CaptureFile, least_side: int) -> np.ndarray:
    """Read a (H, W) uint8 greyscale image, possibly reduced, to no less than `least_side` pixels a side if it has as
    many.

    Raises:
        PocketGSError: as `read_colour`.
    """

    def reduced(image: Image.Image) -> np.ndarray:
        # JPEG can be decoded at 1/2, 1/4 or 1/8 of its size in a fraction of the time; other formats ignore this.
        image.draft("L", (least_side, least_side))
        return high_bytes(image) if image.mode in SIXTEEN_BIT_MODES else np.asarray(image.convert("L"))

    return read_image(path, reduced)


def read_numbers(path: CaptureFile) -> np.ndarray:
    """Read a greyscale image as (H, W) numbers: integers of 8 or 16 bits, or float32.

    Raises:
        PocketGSError: as `read_colour`, or the image is in colour.
    """
    return read_image(path, _numbers)


def read_array(path: Path) -> np.ndarray:
    """Read a .npy file without unpickling.

    Raises:
        PocketGSError: the file is missing, truncated or not a .npy array.
    """
    try:
        # Memory-mapping means that a header which states a huge array allocates nothing.
        array = np.load(checked(path), mmap_mode="r", allow_pickle=False)
        require_memory(path, 2 * array.nbytes, f"an array of shape {array.shape}")
        return np.array(array)
    except PocketGSError:
        raise
    except Exception as error:  # NumPy's header parser raises different types for different damage
        raise PocketGSError(f"{path}: not a readable .npy array ({error})") from error


def high_bytes(image: Image.Image) -> np.ndarray:
    """(H, W) uint8 of a 16-bit greyscale image: Pillow would clip its values at 255 instead of scaling them."""
    return (np.clip(np.asarray(image), 0, 65535) >> 8).astype(np.uint8)


def _opened(path: CaptureFile, read: Callable[[Image.Image], Result]) -> Result:
    try:
        is_file = path.is_file()
    except OSError as error:  # such as a name that is too long
        raise PocketGSError(f"{clipped(path)}: cannot be looked up ({error.strerror or error})") from error
    if not is_file:
        raise PocketGSError(f"{path}: no such file, expected an image")
    try:
        with open_file(path) as file:
            if file.read(8)[4:] == HEIF_MARK:
                _know_heif()
            file.seek(0)
            with Image.open(file) as image:
                return read(image)
    except (PocketGSError, MemoryError):
        raise
    except Image.DecompressionBombError as error:
        raise PocketGSError(f"{path}: has more than {MOST_PIXELS:,} pixels; reduce it to at most as many") from error
    except Exception as error:  # Pillow's decoders raise different types for different damage
        if isinstance(error, OSError) and error.errno is not None:  # of the system, such as a missing permission
            raise PocketGSError(f"{path}: cannot be read ({error.strerror})") from error
        raise UndecodableImageError(
            f"{path}: cannot be decoded ({clipped(error)}), expected a whole image file"
        ) from error


@cache
def _know_heif() -> None:
    """Register HEIF, the format of iPhone photographs, with Pillow. The library is loaded only when needed."""
    import pillow_heif

    pillow_heif.register_heif_opener()


def colour_and_alpha(image: Image.Image) -> tuple[np.ndarray, np.ndarray | None]:
    """(H, W, 3) uint8 sRGB of an image, and its (H, W) uint8 alpha if any pixel is not opaque.

    Raises:
        ValueError: its pixels are floating-point numbers.
    """
    if image.mode == "F":
        raise ValueError("its pixels are floating-point numbers, expected 8 or 16 bits a channel")
    if image.mode in SIXTEEN_BIT_MODES:
        return np.repeat(high_bytes(image)[:, :, None], 3, axis=2), None
    if _has_alpha(image):
        pixels = np.asarray(in_srgb(image.convert("RGBA")))
        alpha = np.ascontiguousarray(pixels[:, :, 3])
        # Many programs save every photograph with alpha. One that is opaque throughout was not cut out.
        return np.ascontiguousarray(pixels[:, :, :3]), None if alpha.min() == OPAQUE else alpha
    if image.mode in ("L", "CMYK"):  # have profiles of their own kinds
        return np.asarray(in_srgb(image).convert("RGB")), None
    return np.asarray(in_srgb(image.convert("RGB"))), None


def _header(image: Image.Image) -> ImageHeader:
    return ImageHeader(*_stored_size(image), _has_alpha(image), _orientation(image), image.format or "")


def _stored_size(image: Image.Image) -> tuple[int, int]:
    """Width and height before EXIF's orientation is applied, which Pillow does to a TIFF's size as it opens it."""
    if isinstance(image, TiffImagePlugin.TiffImageFile):
        width, height = (image.tag_v2[tag] for tag in (TiffImagePlugin.IMAGEWIDTH, TiffImagePlugin.IMAGELENGTH))
        return width, height
    return image.size


def _as_stored(image: Image.Image) -> Image.Image:
    """An image whose pixels EXIF's orientation is not applied to yet: Pillow does that to a TIFF as it decodes it."""
    orientation = _orientation(image)
    if image.format != "TIFF" or orientation == UPRIGHT:
        return image
    stored = image.transpose(TURNS_BACK[orientation])
    exif = stored.getexif()
    with suppress(Exception):  # damaged EXIF data raise different types
        exif.load(image.getexif().tobytes())
    exif[ExifTags.Base.Orientation] = orientation
    return stored


def _has_alpha(image: Image.Image) -> bool:
    return image.mode in ("RGBA", "LA", "PA", "La", "RGBa") or "transparency" in image.info


def _orientation(image: Image.Image) -> int:
    if image.format == "PNG" and "exif" not in image.info:  # Pillow would decode all pixels to find EXIF after them
        return UPRIGHT
    stated = image.getexif().get(ExifTags.Base.Orientation, UPRIGHT)
    return stated if isinstance(stated, int) and UPRIGHT < stated <= max(QUARTER_TURNS) else UPRIGHT


def _numbers(image: Image.Image) -> np.ndarray:
    if image.mode not in (*SIXTEEN_BIT_MODES, "L", "F"):
        raise ValueError(f"mode {image.mode} is not the 16-bit greyscale of a depth map")
    return np.asarray(image)
