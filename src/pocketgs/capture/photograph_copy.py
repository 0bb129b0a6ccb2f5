"""Copies of photographs for structure from motion: upright, 8 bits per channel, in a format that COLMAP reads."""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import count
from pathlib import Path

import numpy as np
from PIL import ExifTags, Image, ImageOps

from pocketgs.capture.decoding.image_file import (
    QUARTER_TURNS,
    UPRIGHT,
    ImageHeader,
    read_colour,
    read_header,
    read_image,
)
from pocketgs.capture.decoding.mask_file import read_mask
from pocketgs.capture.named_images import spelling
from pocketgs.errors import PocketGSError
from pocketgs.files.atomic_file import replacing

COLMAP_SUFFIXES = frozenset({".jpg", ".jpeg", ".jpe", ".jfif", ".png", ".tif", ".tiff", ".bmp"})
COLMAP_FORMATS = frozenset({"JPEG", "MPO", "PNG", "TIFF", "BMP"})
"""Suffixes and formats that COLMAP reads. Of an MPO file under the name .jpg, it reads the first image."""

JPEG_SUFFIXES = (".jpg", ".jpeg")
JPEG_QUALITY = 97

SURROGATES = re.compile("[\ud800-\udfff]")
"""What stands for the bytes of a file name that are not UTF-8."""

MOST_EXIF = 65_533
"""Bytes that fit into a segment of a JPEG file."""


def names_of_copies(photographs: Sequence[Path]) -> dict[Path, str]:
    """The file name of each photograph's copy, see `place_photograph`.

    Names are unique, also where the file system ignores case, and none is that of another photograph: a copy may be a
    hard link to its photograph, which must not be written to. They are Unicode, as COLMAP demands: bytes of other
    encodings, as old archives have them, become underscores.

    Raises:
        PocketGSError: a photograph is not an image.
    """
    own = {spelling(photograph.name) for photograph in photographs}
    names: dict[Path, str] = {}
    taken: set[str] = set()
    for photograph in photographs:
        forbidden = taken | (own - {spelling(photograph.name)})
        names[photograph] = next(name for name in _possible_names(photograph) if spelling(name) not in forbidden)
        taken.add(spelling(names[photograph]))
    return names


def place_photograph(photograph: Path, target: Path) -> None:
    """Write a copy of a photograph to a file of a name from `names_of_copies`.

    A photograph that is stored upright, in a format that COLMAP reads, is hard-linked if the file system can, else
    copied. Others, such as HEIF, are rotated as EXIF states and saved with the rest of their EXIF data: as PNG if they
    have alpha, else as JPEG.

    Raises:
        PocketGSError: the photograph cannot be decoded, or the copy cannot be written.
    """
    header = read_header(photograph)
    if _is_kept(photograph, header):
        _link_or_copy(photograph, target)
        return
    exif = read_image(photograph, _exif_upright)
    colours, alpha = read_colour(photograph, upright=True)
    with replacing(target) as new:
        if header.has_alpha:
            pixels = colours if alpha is None else np.dstack([colours, alpha])
            Image.fromarray(pixels).save(new, "PNG", exif=exif)
        else:
            Image.fromarray(colours).save(new, "JPEG", quality=JPEG_QUALITY, subsampling=0, exif=exif)


def _is_kept(photograph: Path, header: ImageHeader) -> bool:
    """Whether a photograph's copy is the same file. Suffixes count as well: many programs look at nothing else."""
    is_read = photograph.suffix.lower() in COLMAP_SUFFIXES and header.format in COLMAP_FORMATS
    return is_read and header.orientation == UPRIGHT


def _possible_names(photograph: Path) -> Iterator[str]:
    """Names for a photograph's copy, the best first."""
    header, suffix = read_header(photograph), photograph.suffix
    usual = (".png",) if header.has_alpha else JPEG_SUFFIXES
    named = photograph.with_name(SURROGATES.sub("_", photograph.name))
    if not _is_kept(photograph, header) and suffix.lower() not in usual:
        suffix = usual[0]
        yield f"{named.stem}{suffix}"
    yield named.name if suffix == photograph.suffix else f"{named.name}{suffix}"
    yield from (f"{named.stem}_{number}{suffix}" for number in count(2))


def place_masks(
    masks: Mapping[Path, Path],
    names: Mapping[Path, str],
    folder: Path,
    on_unreadable: Callable[[PocketGSError], None] | None = None,
) -> None:
    """Put masks of photographs into a folder of their own, upright, with COLMAP's names.

    A mask's own EXIF states how it is turned. Most programs write none: their masks are of upright photographs if they
    follow EXIF, and of stored pixels if they ignore it. Where a photograph is turned by a quarter, the mask's shape
    tells which; where it is upside down, that of the other masks does. If none tells, masks are of upright photographs.

    Args:
        masks: by photograph.
        names: of the photographs' copies, by photograph.
        folder: for the masks, created if there are any.
        on_unreadable: called for each mask that cannot be decoded, which is left out; if None, its error is raised.

    Raises:
        PocketGSError: a mask cannot be decoded.
    """
    headers = {photograph: (read_header(photograph), _header_of(mask)) for photograph, mask in masks.items()}
    exif_is_ignored = any(of_mask and _is_as_stored(one, of_mask) for one, of_mask in headers.values())
    for photograph, mask in masks.items():
        of_photograph, of_mask = headers[photograph]
        try:
            usable = Image.fromarray(read_mask(mask, upright=True))
            of_mask = of_mask or read_header(mask)
        except PocketGSError as error:
            if on_unreadable is None:
                raise
            on_unreadable(error)
            continue
        by_quarter = of_photograph.orientation in QUARTER_TURNS
        as_stored = _is_as_stored(of_photograph, of_mask) if by_quarter else exif_is_ignored
        if as_stored and of_mask.orientation == UPRIGHT:
            usable = _turned(usable, of_photograph.orientation)
        folder.mkdir(exist_ok=True)
        usable.save(folder / f"{names[photograph]}.png")


def _header_of(mask: Path) -> ImageHeader | None:
    """None if it cannot be read: then the mask cannot be decoded either."""
    try:
        return read_header(mask)
    except PocketGSError:
        return None


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
        with replacing(target) as new:
            shutil.copyfile(source, new)
