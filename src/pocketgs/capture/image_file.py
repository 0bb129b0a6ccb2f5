"""Image files as arrays, as stored unless the caller asks for the turn that EXIF states."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TypeVar

import numpy as np
from PIL import ExifTags, Image, ImageOps

from pocketgs.errors import PocketGSError, clipped
from pocketgs.files.memory_bound import require_memory
from pocketgs.files.opening import checked, open_file
from pocketgs.files.paths import CaptureFile

Result = TypeVar("Result")

# What Pillow warns of names a line of its own source; sizes are checked here.
warnings.filterwarnings("ignore", module=r"PIL\.")

SIXTEEN_BIT_MODES = ("I", "I;16", "I;16B", "I;16L", "I;16N")
HEIF_SUFFIXES = frozenset({".heic", ".heif"})

DECODING, DECODING_ALPHA = 24, 40
"""Bytes by pixel of a photograph that is being read, and of one with alpha."""

UPRIGHT, QUARTER_TURNS = 1, (5, 6, 7, 8)  # values of EXIF's tag Orientation


@dataclass(frozen=True)
class ImageHeader:
    """What an image file's header states.

    Attributes:
        width, height: in pixels, as stored.
        has_alpha: whether the pixels have alpha.
        orientation: how a viewer is to turn the pixels, EXIF's tag Orientation: 1 for not at all.
    """

    width: int
    height: int
    has_alpha: bool
    orientation: int = UPRIGHT

    @property
    def upright_size(self) -> tuple[int, int]:
        """Width and height of the image when it is turned as EXIF states."""
        turned = self.orientation in QUARTER_TURNS
        return (self.height, self.width) if turned else (self.width, self.height)


def read_header(path: CaptureFile) -> ImageHeader:
    """The header of an image file, decoding no pixel.

    Raises:
        PocketGSError: the file is missing or no image.
    """
    return _opened(path, lambda image: ImageHeader(*image.size, _has_alpha(image), _orientation(image)))


def read_size(path: CaptureFile) -> tuple[int, int]:
    """Width and height of an image file, from its header alone.

    Raises:
        PocketGSError: the file is missing or no image.
    """
    return _opened(path, lambda image: image.size)


def read_colour(path: CaptureFile, upright: bool = False) -> tuple[np.ndarray, np.ndarray | None]:
    """The colours of an image file, and its alpha where it has one.

    Of a file with several pictures, as cameras with two lenses write them, the first is read. 16 bits become 8.

    Args:
        path: the file.
        upright: turn the image as EXIF states; otherwise it is as stored.

    Returns:
        (H, W, 3) uint8 RGB and (H, W) uint8 alpha or None.

    Raises:
        PocketGSError: the file is missing, truncated, damaged or far too large.
    """
    return _decoded(path, lambda image: _colour_and_alpha(ImageOps.exif_transpose(image) if upright else image))


def read_image(path: CaptureFile, read: Callable[[Image.Image], Result]) -> Result:
    """What a function makes of an image that Pillow has opened.

    Raises:
        PocketGSError: as `read_colour`, or whatever else the function raises, with the file's name.
    """
    return _decoded(path, read)


def read_grey(path: CaptureFile, least_side: int) -> np.ndarray:
    """(H, W) uint8 grey image, perhaps reduced, but to no less than `least_side` pixels a side if it has as many.

    Raises:
        PocketGSError: as `read_colour`.
    """

    def reduced(image: Image.Image) -> np.ndarray:
        # JPEG can be decoded at 1/2, 1/4 or 1/8 of its size in a fraction of the time; other formats ignore this.
        image.draft("L", (least_side, least_side))
        return high_bytes(image) if image.mode in SIXTEEN_BIT_MODES else np.asarray(image.convert("L"))

    return _decoded(path, reduced)


def read_whole_numbers(path: CaptureFile) -> np.ndarray:
    """The values of an 8- or 16-bit greyscale image, (H, W) of an integer type.

    Raises:
        PocketGSError: as `read_colour`, or the image has colours.
    """
    return _decoded(path, _whole_numbers)


def read_array(path: Path) -> np.ndarray:
    """The array of a .npy file; never unpickles.

    Raises:
        PocketGSError: the file is missing, truncated or not a .npy array.
    """
    try:
        # Mapping the file first means that a header which states a huge array allocates nothing.
        array = np.load(checked(path), mmap_mode="r", allow_pickle=False)
        require_memory(path, 2 * array.nbytes, f"an array of shape {array.shape}")
        return np.array(array)
    except PocketGSError:
        raise
    except Exception as error:  # what NumPy's header parser raises depends on where the damage is
        raise PocketGSError(f"{path}: not a readable .npy array ({error})") from error


def high_bytes(image: Image.Image) -> np.ndarray:
    """(H, W) uint8 of a 16-bit grey image, whose values Pillow would cut off at 255 in place of scaling them."""
    return (np.clip(np.asarray(image), 0, 65535) >> 8).astype(np.uint8)


def _decoded(path: CaptureFile, read: Callable[[Image.Image], Result]) -> Result:
    """What a function makes of an image whose pixels there is room for."""

    def bounded(image: Image.Image) -> Result:
        pixel_bytes = DECODING_ALPHA if _has_alpha(image) else DECODING
        require_memory(path, pixel_bytes * image.width * image.height, f"{image.width}x{image.height} pixels")
        return read(image)

    return _opened(path, bounded)


def _opened(path: CaptureFile, read: Callable[[Image.Image], Result]) -> Result:
    if not path.is_file():
        raise PocketGSError(f"{path}: no such file, expected an image")
    if Path(path.name).suffix.lower() in HEIF_SUFFIXES:
        _know_heif()
    try:
        with open_file(path) as file, Image.open(file) as image:
            return read(image)
    except PocketGSError:
        raise
    except Exception as error:  # Pillow's decoders raise whatever the damage trips over
        raise PocketGSError(f"{path}: cannot be decoded ({clipped(error)}), expected a whole image file") from error


@cache
def _know_heif() -> None:
    """Let Pillow open HEIF, the format of iPhones' photographs. The library is loaded where it is needed only."""
    import pillow_heif

    pillow_heif.register_heif_opener()


def _colour_and_alpha(image: Image.Image) -> tuple[np.ndarray, np.ndarray | None]:
    if image.mode == "F":
        raise ValueError("its pixels are floating-point numbers, expected 8 or 16 bits a channel")
    if image.mode in SIXTEEN_BIT_MODES:
        return np.repeat(high_bytes(image)[:, :, None], 3, axis=2), None
    if _has_alpha(image):
        pixels = np.asarray(image.convert("RGBA"))
        return np.ascontiguousarray(pixels[:, :, :3]), np.ascontiguousarray(pixels[:, :, 3])
    return np.asarray(image.convert("RGB")), None


def _has_alpha(image: Image.Image) -> bool:
    return image.mode in ("RGBA", "LA", "PA", "La", "RGBa") or "transparency" in image.info


def _orientation(image: Image.Image) -> int:
    if image.format == "TIFF":  # Pillow turns these by itself, and states the size that they then have
        return UPRIGHT
    if image.format == "PNG" and "exif" not in image.info:  # Pillow would decode all pixels to look behind them
        return UPRIGHT
    stated = image.getexif().get(ExifTags.Base.Orientation, UPRIGHT)
    return stated if isinstance(stated, int) and UPRIGHT < stated <= max(QUARTER_TURNS) else UPRIGHT


def _whole_numbers(image: Image.Image) -> np.ndarray:
    if image.mode not in (*SIXTEEN_BIT_MODES, "L"):
        raise ValueError(f"mode {image.mode} is not the 16-bit greyscale of a depth map")
    return np.asarray(image)
