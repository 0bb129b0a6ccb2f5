"""Paths of a capture's files, which must lie inside the folder that was given, and names in archives."""

from __future__ import annotations

import os
import re
from importlib.util import find_spec
from pathlib import Path

from pocketgs.errors import PocketGSError, short
from pocketgs.files.opening import folders_around

IMAGE_SUFFIXES = frozenset(
    {".png", ".jpg", ".jpeg", ".jpe", ".jfif", ".mpo", ".heic", ".heif", ".tif", ".tiff", ".webp", ".bmp"}
    | ({".avif"} if find_spec("PIL._avif") else set())  # only some builds of Pillow have it
)
UNREAD_SUFFIXES = (
    frozenset({".dng", ".cr2", ".cr3", ".nef", ".arw", ".raf", ".orf", ".rw2", ".gif", ".jp2", ".jxl", ".psd", ".avif"})
    - IMAGE_SUFFIXES
)
"""Suffixes of pictures that are not read, such as cameras' raw data."""

OTHER_PICTURES = (
    r"(mask(ed)?|depth|conf(idence)?|normal|seg(ment(ation)?)?|label|thumb(nail)?|preview)(map|image)?s?(?![a-z])"
    r"|held_out|transients|\.|__"
)
"""How the names of folders begin whose images share photographs' names but are not photographs."""

_HERE = re.compile(r"(\./)+(?=[^/])")


def inside(folder: Path, name: str, named_in: str) -> Path:
    """The path of `name` inside `folder`, whether or not it exists.

    A capture is often downloaded, so the files that it names must not reach the rest of the disk. They may lie beside
    the folder if a folder around it is being read: `calibration/transforms.json` may name `../photos/1.jpg`.

    Args:
        folder: the capture's folder.
        name: a relative path as the capture states it, with `/` as the separator.
        named_in: the file that states it, for error messages.

    Raises:
        PocketGSError: the path is absolute, or leaves the folder that is being read by `..` or a symbolic link.
    """
    try:
        *_, boundary = folders_around(folder)
        path = Path(os.path.normpath(folder / name))
        stays = not Path(name).is_absolute() and path.resolve().is_relative_to(boundary.resolve())
    except (OSError, ValueError, RuntimeError) as error:
        reason = getattr(error, "strerror", None) or short(str(error))
        raise PocketGSError(
            f"{named_in}: names the file {short(name)}, which is not a usable path ({reason})"
        ) from error
    if not stays:
        elsewhere = f"{named_in}: names the file {short(name)}, which lies outside the capture's folder {boundary}"
        raise PocketGSError(elsewhere + ("; give a folder that holds both" if _may_hold_both(path, boundary) else ""))
    return path


def _may_hold_both(file: Path, folder: Path) -> bool:
    """Whether a capture may be read from the closest folder around a file and a folder.

    Photographs directly in that could be taken for a capture without poses.
    """
    file, folder = file.absolute(), folder.absolute()
    both = os.path.commonpath([file, folder])
    return file.is_file() and both not in (str(folder), str(file.parent))


def existing_file(folder: Path, name: str, named_in: str, suffixes: tuple[str, ...] = ("",)) -> Path | None:
    """The first `name` + suffix that is a file inside `folder`, or None.

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


def without_here(name: str) -> str:
    """A name in a zip file without the `./` that some programs begin all names with, such as bsdtar."""
    here = _HERE.match(name)
    return name[here.end() :] if here else name


def relative_name(path: Path, folder: Path) -> str:
    """Frame name of an image file: its path inside the capture's folder, with `/` as the separator."""
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
    """Whether a path is an image file by its suffix, and not one of the hidden files that macOS adds."""
    return path.suffix.lower() in IMAGE_SUFFIXES and not path.name.startswith(".") and path.is_file()


def is_folder_of_photographs(path: Path) -> bool:
    """Whether a folder holds photographs, judging by its name."""
    return path.is_dir() and not re.match(OTHER_PICTURES, path.name.lower())
