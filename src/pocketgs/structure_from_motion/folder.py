"""The folder of a posed capture: put in place whole or not at all, with a record of what it was made from."""

from __future__ import annotations

import json
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from glob import escape
from pathlib import Path
from typing import Any

from pocketgs.errors import PocketGSError
from pocketgs.interrupt import deferred_interrupt

IMAGES, MODEL, RECORD = "images", "sparse", "posed.json"


def read_record(folder: Path) -> dict[str, Any] | None:
    """What a posed capture says of its making, or None where there is none."""
    try:
        record = json.loads((folder / RECORD).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return record if isinstance(record, dict) else None


def check_replaceable(folder: Path) -> None:
    """Refuse to replace anything but an empty folder or an earlier posed capture with nothing added to it.

    Raises:
        PocketGSError: there is something else.
    """
    if not os.path.lexists(folder):
        return
    if not folder.is_dir():
        raise PocketGSError(f"{folder}: is a file, expected a folder for the posed capture")
    found = {path.name for path in folder.iterdir()}
    foreign = found - {IMAGES, MODEL, RECORD} if read_record(folder) is not None else found
    if foreign:
        raise PocketGSError(
            f"{folder}: holds {sorted(foreign)[0]}, expected an empty folder or an earlier result of pocketgs pose"
        )


@contextmanager
def replacing_folder(folder: Path) -> Iterator[tuple[Path, Path]]:
    """Give an empty folder to write to, and one for what is needed in between; put the first in place at the end.

    Whatever goes wrong in between, `folder` holds what it held before.

    Raises:
        PocketGSError: it cannot be written.
    """
    folder = folder.resolve()
    made = [path for path in folder.parents if not path.exists()]
    try:
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
    except OSError as error:
        raise PocketGSError(f"{folder}: cannot be written ({error.strerror or error})") from error


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
