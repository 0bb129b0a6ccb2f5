"""Folders that appear whole or not at all."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from glob import escape
from pathlib import Path

from pocketgs.interrupt import deferred_interrupt


@contextmanager
def replacing_folder(folder: Path) -> Iterator[tuple[Path, Path]]:
    """Give an empty folder to write to, and one for what is needed in between; put the first in place at the end.

    Whatever goes wrong in between, `folder` holds what it held before.

    Raises:
        OSError: it cannot be written.
    """
    folder = folder.resolve()
    made = [path for path in folder.parents if not path.exists()]
    temporary = _temporary_sibling(folder)
    try:
        staging, workspace = temporary / "new", temporary / "work"
        staging.mkdir()
        workspace.mkdir()
        yield staging, workspace
        with deferred_interrupt():
            _swap(staging, folder, temporary / "old")
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
        with suppress(OSError):
            for path in made:
                path.rmdir()  # refuses if anything is in there


def _temporary_sibling(folder: Path) -> Path:
    """A new hidden folder beside `folder`, where what killed processes have left behind is cleared away."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    for leftover in folder.parent.glob(f".{escape(folder.name)}.*.partial"):
        shutil.rmtree(leftover, ignore_errors=True)
    return Path(tempfile.mkdtemp(prefix=f".{folder.name}.", suffix=".partial", dir=folder.parent))


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
