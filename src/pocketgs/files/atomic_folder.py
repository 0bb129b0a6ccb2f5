"""Atomic folder writes."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from glob import escape
from pathlib import Path

from pocketgs.files.lock import locked
from pocketgs.system.interrupt import deferred_interrupt

NEW, OLD = "new", "old"
"""In a temporary folder: what is to come, and the earlier content that has made way for it."""


@contextmanager
def replacing_folder(folder: Path) -> Iterator[tuple[Path, Path]]:
    """Give an empty folder to write to, and one for what is needed in between; put the first in place at the end.

    Whatever goes wrong in between, `folder` holds what it held before; if the process is killed at the moment when it
    moves the earlier content out of the way, whoever writes there next puts it back.

    Raises:
        InUseError: another process is doing the same.
        OSError: it cannot be written.
    """
    folder = folder.resolve()
    made = [path for path in folder.parents if not path.exists()]
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        with locked(folder.with_name(f".{folder.name}.lock"), folder):
            _clear_leftovers(folder)
            yield from _replacing(folder)
    finally:
        with suppress(OSError):
            for path in made:
                path.rmdir()  # refuses if anything is in there


def _replacing(folder: Path) -> Iterator[tuple[Path, Path]]:
    temporary = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", suffix=".partial", dir=folder.parent))
    try:
        staging, workspace = temporary / NEW, temporary / "work"
        staging.mkdir()
        workspace.mkdir()
        yield staging, workspace
        with deferred_interrupt():
            _swap(staging, folder, temporary / OLD)
    finally:
        if not _is_half_swapped(temporary, folder):
            shutil.rmtree(temporary, ignore_errors=True)


def _clear_leftovers(folder: Path) -> None:
    """Clear away what killed processes have left beside `folder`, and put back what they had moved out of the way."""
    for leftover in folder.parent.glob(f".{escape(folder.name)}.*.partial"):
        if _is_half_swapped(leftover, folder):
            os.replace(leftover / OLD, folder)
        shutil.rmtree(leftover, ignore_errors=True)


def _is_half_swapped(temporary: Path, folder: Path) -> bool:
    """Whether the earlier content has gone from `folder` and nothing has come in its place."""
    return (temporary / OLD).is_dir() and not os.path.lexists(folder)


def _swap(new: Path, folder: Path, old: Path) -> None:
    """Put `new` in the place of `folder`, whose earlier content goes to `old`."""
    existed = folder.exists()
    if existed:
        os.replace(folder, old)
    try:
        os.replace(new, folder)
    except OSError:
        if existed:
            os.replace(old, folder)
        raise
