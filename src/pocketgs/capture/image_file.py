"""Image files as arrays, exactly as stored: EXIF orientation is not applied, since poses refer to stored pixels."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np
from PIL import Image

from pocketgs.capture.paths import CaptureFile
from pocketgs.errors import PocketGSError

Result = TypeVar("Result")

SIXTEEN_BIT_MODES = ("I", "I;16", "I;16B", "I;16L", "I;16N")


@dataclass(frozen=True)
class ImageHeader:
    """What an image file's header states: width and height in pixels, and whether the pixels have alpha."""

    width: int
    height: int
    has_alpha: bool


def read_header(path: CaptureFile) -> ImageHeader:
    """The header of an image file, decoding no pixel.

    Raises:
        PocketGSError: the file is missing or no image.
    """
    return _opened(path, lambda image: ImageHeader(*image.size, has_alpha=_has_alpha(image)))


def read_size(path: CaptureFile) -> tuple[int, int]:
    """Width and height of an image file, from its header alone.

    Raises:
        PocketGSError: the file is missing or no image.
    """
    return _opened(path, lambda image: image.size)


def read_colour(path: CaptureFile) -> tuple[np.ndarray, np.ndarray | None]:
    """The colours of an image file, and its alpha where it has one.

    Returns:
        (H, W, 3) uint8 RGB and (H, W) uint8 alpha or None.

    Raises:
        PocketGSError: the file is missing, truncated, damaged or far too large.
    """
    return _opened(path, _colour_and_alpha)


def read_mask(path: CaptureFile) -> np.ndarray:
    """(H, W) bool, True where an image file is not black.

    Raises:
        PocketGSError: as `read_colour`.
    """
    return _opened(path, _grey) > 0


def read_grey(path: CaptureFile, least_side: int) -> np.ndarray:
    """(H, W) uint8 grey image, perhaps reduced, but to no less than `least_side` pixels a side if it has as many.

    Raises:
        PocketGSError: as `read_colour`.
    """

    def reduced(image: Image.Image) -> np.ndarray:
        # JPEG can be decoded at 1/2, 1/4 or 1/8 of its size in a fraction of the time; other formats ignore this.
        image.draft("L", (least_side, least_side))
        return np.asarray(image.convert("L"))

    return _opened(path, reduced)


def read_whole_numbers(path: CaptureFile) -> np.ndarray:
    """The values of an 8- or 16-bit greyscale image, (H, W) of an integer type.

    Raises:
        PocketGSError: as `read_colour`, or the image has colours.
    """
    return _opened(path, _whole_numbers)


def read_array(path: Path) -> np.ndarray:
    """The array of a .npy file; never unpickles.

    Raises:
        PocketGSError: the file is missing, truncated or not a .npy array.
    """
    try:
        # Mapping the file first means that a header which states a huge array allocates nothing.
        array = np.load(path, mmap_mode="r", allow_pickle=False)
        return np.array(array)
    except Exception as error:  # what NumPy's header parser raises depends on where the damage is
        raise PocketGSError(f"{path}: not a readable .npy array ({error})") from error


def _opened(path: CaptureFile, read: Callable[[Image.Image], Result]) -> Result:
    if not path.is_file():
        raise PocketGSError(f"{path}: no such file, expected an image")
    try:
        with path.open("rb") as file, Image.open(file) as image:
            return read(image)
    except PocketGSError:
        raise
    except Exception as error:  # Pillow's decoders raise whatever the damage trips over
        raise PocketGSError(f"{path}: cannot be decoded ({error}), expected a whole image file") from error


def _colour_and_alpha(image: Image.Image) -> tuple[np.ndarray, np.ndarray | None]:
    if image.mode in SIXTEEN_BIT_MODES:
        high_byte = (np.clip(np.asarray(image), 0, 65535) >> 8).astype(np.uint8)
        return np.repeat(high_byte[:, :, None], 3, axis=2), None
    if _has_alpha(image):
        pixels = np.asarray(image.convert("RGBA"))
        return np.ascontiguousarray(pixels[:, :, :3]), np.ascontiguousarray(pixels[:, :, 3])
    return np.asarray(image.convert("RGB")), None


def _has_alpha(image: Image.Image) -> bool:
    return image.mode in ("RGBA", "LA", "PA", "La", "RGBa") or "transparency" in image.info


def _grey(image: Image.Image) -> np.ndarray:
    return np.asarray(image if image.mode in SIXTEEN_BIT_MODES else image.convert("L"))


def _whole_numbers(image: Image.Image) -> np.ndarray:
    if image.mode not in (*SIXTEEN_BIT_MODES, "L"):
        raise ValueError(f"mode {image.mode} is not the 16-bit greyscale of a depth map")
    return np.asarray(image)
