"""Files that a capture names: they must lie inside the capture's own folder."""

from __future__ import annotations

import os
import zipfile
from pathlib import Path
from typing import TypeAlias

from pocketgs.errors import PocketGSError, short

CaptureFile: TypeAlias = Path | zipfile.Path
"""A file of a capture: on disk, or inside an archive, which is then read without unpacking it."""

IMAGE_SUFFIXES = frozenset({".png", ".jpg", ".jpeg", ".mpo", ".heic", ".heif", ".tif", ".tiff", ".webp", ".bmp"})

OTHER_PICTURES = ("mask", "depth", "conf", "normal", "seg", "label", "thumb", "preview", "held_out", ".", "__")
"""How the names of folders begin whose pictures may bear photographs' names and are none."""


def inside(folder: Path, name: str, named_in: str) -> Path:
    """The path of `name` inside `folder`, whether or not it exists.

    A capture is often somebody else's download, so what its files name may not reach the rest of the disk.

    Args:
        folder: the capture's folder.
        name: a relative path as the capture states it, with `/` between its parts.
        named_in: where it is stated, for error messages.

    Raises:
        PocketGSError: the path is absolute or leaves the folder, by `..` or by a symbolic link.
    """
    try:
        path = Path(os.path.normpath(folder / name))
        stays = not Path(name).is_absolute() and path.resolve().is_relative_to(folder.resolve())
    except (OSError, ValueError, RuntimeError) as error:
        reason = getattr(error, "strerror", None) or short(str(error))
        raise PocketGSError(
            f"{named_in}: names the file {short(name)}, which is not a usable path ({reason})"
        ) from error
    if not stays:
        raise PocketGSError(
            f"{named_in}: names the file {short(name)}, which lies outside the capture's folder {folder}"
        )
    return path


def existing_file(folder: Path, name: str, named_in: str, suffixes: tuple[str, ...] = ("",)) -> Path | None:
    """The first of `name` + suffix that is a file inside `folder`, or None.

    Raises:
        PocketGSError: as `inside`.
    """
    for suffix in suffixes:
        path = inside(folder, name + suffix, named_in)
        try:
            if path.is_file():
                return path
        except OSError as error:
            found = f"{named_in}: names the file {short(name)}, which cannot be looked up ({error.strerror or error})"
            raise PocketGSError(found) from error
    return None


def relative_name(path: Path, folder: Path) -> str:
    """The frame name of an image file: its path inside the capture's folder, with `/` between its parts."""
    return Path(os.path.relpath(path, folder)).as_posix()


def list_images(folder: Path) -> list[Path]:
    """The image files directly in a folder, sorted by name.

    Raises:
        PocketGSError: the folder does not exist.
    """
    if not folder.is_dir():
        raise PocketGSError(f"{folder}: no such folder, expected one with images")
    return sorted(filter(is_image, folder.iterdir()), key=lambda path: path.name)


def is_image(path: Path) -> bool:
    """Whether a path is a file with an image's suffix, and none of the hidden ones that macOS puts beside others."""
    return path.suffix.lower() in IMAGE_SUFFIXES and not path.name.startswith(".") and path.is_file()


def is_folder_of_photographs(path: Path) -> bool:
    """Whether a path is a folder whose images are photographs, as far as its name tells."""
    return path.is_dir() and not path.name.lower().startswith(OTHER_PICTURES)
