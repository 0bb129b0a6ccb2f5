"""Copies of photographs for structure from motion: upright, 8 bits per channel, in a format that COLMAP reads."""

from __future__ import annotations

import os
import shutil
from collections.abc import Mapping
from glob import escape
from pathlib import Path

from PIL import ExifTags, Image, ImageOps

from pocketgs.capture.image_file import QUARTER_TURNS, UPRIGHT, ImageHeader, read_colour, read_header, read_image
from pocketgs.capture.mask_file import read_mask

READ_BY_COLMAP = frozenset({".jpg", ".jpeg", ".png", ".tif", ".tiff", ".bmp"})
JPEG_QUALITY = 97

MOST_EXIF = 65_533
"""Bytes that fit into a segment of a JPEG file."""


def place_photograph(photograph: Path, folder: Path) -> Path:
    """Put a photograph into a folder.

    A photograph that is stored upright, in a format that COLMAP reads, is hard-linked if the file system can, else
    copied. Others, such as HEIF, are rotated as EXIF states and saved as JPEG with the rest of their EXIF data.

    Returns:
        The new file.

    Raises:
        PocketGSError: the photograph cannot be decoded.
    """
    if photograph.suffix.lower() in READ_BY_COLMAP and read_header(photograph).orientation == UPRIGHT:
        target = folder / photograph.name
        _link_or_copy(photograph, target)
        return target
    taken = len(list(photograph.parent.glob(f"{escape(photograph.stem)}.*"))) > 1
    is_jpeg = photograph.suffix.lower() in (".jpg", ".jpeg")
    target = folder / (photograph.name if is_jpeg else f"{photograph.name if taken else photograph.stem}.jpg")
    exif = read_image(photograph, _exif_upright)
    colours, _ = read_colour(photograph, upright=True)
    Image.fromarray(colours).save(target, quality=JPEG_QUALITY, subsampling=0, exif=exif)
    return target


def place_masks(masks: Mapping[Path, Path], placed: Mapping[Path, Path], folder: Path) -> None:
    """Put masks of photographs into a folder of their own, upright, with COLMAP's names.

    A mask's own EXIF states how it is turned. Most programs write none: their masks are of upright photographs if they
    follow EXIF, and of stored pixels if they ignore it. Where a photograph is turned by a quarter, the mask's shape
    tells which; where it is upside down, that of the other masks does. If none tells, masks are of upright photographs.

    Args:
        masks: by photograph.
        placed: the result of `place_photograph` by photograph.
        folder: for the masks, created if there are any.

    Raises:
        PocketGSError: a mask cannot be decoded.
    """
    if masks:
        folder.mkdir()
    headers = {photograph: (read_header(photograph), read_header(mask)) for photograph, mask in masks.items()}
    exif_is_ignored = any(_is_as_stored(*pair) for pair in headers.values())
    for photograph, mask in masks.items():
        of_photograph, of_mask = headers[photograph]
        usable = Image.fromarray(read_mask(mask, upright=True))
        by_quarter = of_photograph.orientation in QUARTER_TURNS
        as_stored = _is_as_stored(of_photograph, of_mask) if by_quarter else exif_is_ignored
        if as_stored and of_mask.orientation == UPRIGHT:
            usable = _turned(usable, of_photograph.orientation)
        usable.save(folder / f"{placed[photograph].name}.png")


def _is_as_stored(photograph: ImageHeader, mask: ImageHeader) -> bool:
    """Whether a mask without EXIF has the shape of stored pixels, at any size, and not that of the upright picture."""
    by_quarter = photograph.orientation in QUARTER_TURNS
    has_stored_shape = (mask.width > mask.height) == (photograph.width > photograph.height)
    return by_quarter and mask.orientation == UPRIGHT and has_stored_shape


def _turned(image: Image.Image, orientation: int) -> Image.Image:
    image.getexif()[ExifTags.Base.Orientation] = orientation
    return ImageOps.exif_transpose(image)


def _exif_upright(image: Image.Image) -> bytes:
    """EXIF data but for the orientation, and for long notes that JPEG has no room for; nothing if it is damaged."""
    try:
        exif = image.getexif()
        exif.pop(ExifTags.Base.Orientation, None)
        if len(exif.tobytes()) > MOST_EXIF:
            details = exif.get_ifd(ExifTags.IFD.Exif)
            for notes in (ExifTags.Base.MakerNote, ExifTags.Base.UserComment):
                details.pop(notes, None)
        stored = exif.tobytes()
    except Exception:  # damaged EXIF data raise different types
        return b""
    return stored if len(stored) <= MOST_EXIF else b""


def _link_or_copy(source: Path, target: Path) -> None:
    try:
        os.link(source.resolve(), target)
    except OSError:  # another file system, or no hard links
        shutil.copyfile(source, target)
