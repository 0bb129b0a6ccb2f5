"""Opening a capture's files: only inside the folder that was given, and within the memory bound.

A capture is often downloaded. The files that it names must not reach the rest of the disk, not even through a symbolic
link that replaces a file after the capture was listed; so each file is checked when it is opened.
"""

from __future__ import annotations

import os
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import BinaryIO, TypeAlias, cast

from pocketgs.errors import PocketGSError
from pocketgs.files.memory_bound import require_memory

CaptureFile: TypeAlias = Path | zipfile.Path
"""A file of a capture, on disk or inside an archive that is read without unpacking."""

_folder: ContextVar[Path | None] = ContextVar("folder", default=None)


def folder_of(capture: Path) -> Path | None:
    """The folder that a capture's files must lie in; None for an archive, which contains its files."""
    if capture.is_dir():
        return capture
    return capture.parent if capture.suffix.lower() == ".json" else None


@contextmanager
def reading_inside(folder: Path | None) -> Iterator[None]:
    """Restrict what this thread opens while the block runs to a folder; None lifts the restriction."""
    before = _folder.set(None if folder is None else folder.resolve())
    try:
        yield
    finally:
        _folder.reset(before)


def folders_around(folder: Path) -> list[Path]:
    """The folder and those around it, up to the one that is being read; only itself if that is not around it."""
    boundary = _folder.get()
    places = [folder, *folder.parents] if boundary else []
    ends = (number for number, place in enumerate(places, 1) if place.resolve() == boundary)
    return places[: next(ends, 0)] or [folder]


def checked(path: Path) -> Path:
    """Check a path that a library will open by name.

    Raises:
        PocketGSError: it lies outside the folder that is being read, or cannot be resolved.
    """
    folder = _folder.get()
    if folder is None:
        return path
    try:
        is_inside = path.resolve().is_relative_to(folder)
    except (OSError, RuntimeError) as error:  # circular links
        raise PocketGSError(f"{path}: cannot be opened ({error})") from error
    if not is_inside:
        raise PocketGSError(f"{path}: lies outside the capture's folder {folder}, expected a file inside it")
    return path


@contextmanager
def open_file(path: CaptureFile) -> Iterator[BinaryIO]:
    """Open a file of a capture for reading.

    Raises:
        PocketGSError: it lies outside the folder that is being read.
        OSError: it cannot be opened.
    """
    if isinstance(path, zipfile.Path):
        with path.open("rb") as member:
            yield cast(BinaryIO, member)
        return
    with checked(path).open("rb") as file:
        # The path may have been replaced between the check and the opening.
        if _folder.get() is not None and not os.path.samestat(os.fstat(file.fileno()), checked(path).stat()):
            raise PocketGSError(f"{path}: was replaced while it was being opened")
        yield file


def read_bytes(path: CaptureFile) -> bytes:
    """Read a whole file of a capture.

    Raises:
        PocketGSError: it lies outside the folder that is being read, or exceeds the memory bound.
        OSError: it cannot be read.
    """
    with open_file(path) as file:
        if isinstance(path, zipfile.Path):
            size = path.root.getinfo(path.at).file_size
        else:
            size = os.fstat(file.fileno()).st_size
        require_memory(path, size, f"its {size:,} bytes")
        return file.read()


def open_in_place(path: Path) -> BinaryIO:
    """Open a file at its real path, as `Path.resolve` returned it; fail if a link has replaced it since.

    Raises:
        OSError: it cannot be opened, or leads elsewhere now.
    """
    file = path.open("rb")
    if path.resolve() != path or not os.path.samestat(os.fstat(file.fileno()), path.stat()):
        file.close()
        raise OSError(f"{path}: leads elsewhere")
    return file
