"""Thumbnails: small JPEGs of a photograph before a capture is trained, and of a rendering after it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image

from pocketgs.capture.decoding.image_file import read_colour
from pocketgs.files.atomic_file import replacing
from pocketgs.results.folder import PICTURES

LONGER_SIDE = 640
QUALITY = 82


def write_thumbnail(path: Path, picture: Path | np.ndarray) -> None:
    """Write a thumbnail.

    Args:
        path: ends in .jpg.
        picture: an image file, or (H, W, 3) uint8.

    Raises:
        PocketGSError: the image cannot be read, or the thumbnail cannot be written.
    """
    pixels = picture if isinstance(picture, np.ndarray) else read_colour(picture, upright=True)[0]
    image = Image.fromarray(pixels)
    image.thumbnail((LONGER_SIDE, LONGER_SIDE))
    with replacing(path) as partial:
        image.save(partial, "JPEG", quality=QUALITY)


def show_rendering(path: Path, result: Path) -> None:
    """Write a thumbnail of a result's rendering of a held-out view; without one, the thumbnail stays as it is.

    Args:
        path: ends in .jpg.
        result: folder of the result.

    Raises:
        PocketGSError: the rendering cannot be read, or the thumbnail cannot be written.
    """
    found = sorted((result / PICTURES).glob("*.png"))
    if found:
        pair, _ = read_colour(found[len(found) // 2])  # the photograph and, right of it, the rendering
        write_thumbnail(path, np.ascontiguousarray(pair[:, pair.shape[1] // 2 :]))
