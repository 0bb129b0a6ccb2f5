"""The one way in which a capture's files are opened: from inside its folder, and no more than memory holds.

A capture is often somebody else's download. What its files name must not reach the rest of the disk, also not through
a symbolic link that is put in a file's place after the capture was listed; so each file is looked at when it is opened.
"""

from __future__ import annotations

import os
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, cast

from pocketgs.errors import PocketGSError
from pocketgs.files.memory_bound import require_memory

if TYPE_CHECKING:
    from pocketgs.files.paths import CaptureFile

_folder: ContextVar[Path | None] = ContextVar("folder", default=None)


def folder_of(capture: Path) -> Path | None:
    """The folder that a capture's files may not leave; None for an archive, whose files lie in it."""
    if capture.is_dir():
        return capture
    return capture.parent if capture.suffix.lower() == ".json" else None


@contextmanager
def reading_inside(folder: Path | None) -> Iterator[None]:
    """While the block runs, what this thread opens here must lie inside a folder; None for wherever it lies."""
    before = _folder.set(None if folder is None else folder.resolve())
    try:
        yield
    finally:
        _folder.reset(before)


def checked(path: Path) -> Path:
    """A file for a library that opens files by name itself.

    Raises:
        PocketGSError: it lies outside of the folder that is being read, or is no regular file.
    """
    folder = _folder.get()
    if folder is None:
        return path
    try:
        is_inside = path.resolve().is_relative_to(folder)
    except (OSError, RuntimeError) as error:  # links that lead in circles
        raise PocketGSError(f"{path}: cannot be opened ({error})") from error
    if not is_inside:
        raise PocketGSError(f"{path}: lies outside the capture's folder {folder}, expected a file inside it")
    return path


@contextmanager
def open_file(path: CaptureFile) -> Iterator[BinaryIO]:
    """A file of a capture, to be read.

    Raises:
        PocketGSError: it lies outside of the folder that is being read.
        OSError: it cannot be opened.
    """
    if isinstance(path, zipfile.Path):
        with path.open("rb") as member:
            yield cast(BinaryIO, member)
        return
    with checked(path).open("rb") as file:
        # The name may have come to mean another file between the look at it and its opening.
        if _folder.get() is not None and not os.path.samestat(os.fstat(file.fileno()), checked(path).stat()):
            raise PocketGSError(f"{path}: was replaced while it was being opened")
        yield file


def read_bytes(path: CaptureFile) -> bytes:
    """All of a file of a capture.

    Raises:
        PocketGSError: it lies outside of the folder that is being read, or needs more memory than there may be.
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
    """A file at its real path, as `Path.resolve` gave it: refused where a link stands in its way by now.

    Raises:
        OSError: it cannot be opened, or has been replaced by what leads elsewhere.
    """
    file = path.open("rb")
    if path.resolve() != path or not os.path.samestat(os.fstat(file.fileno()), path.stat()):
        file.close()
        raise OSError(f"{path}: leads elsewhere")
    return file
