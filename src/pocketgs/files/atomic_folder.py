"""Atomic folder writes."""

from __future__ import annotations

import os
import shutil
import tempfile
import uuid
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from glob import escape
from pathlib import Path

from pocketgs.errors import PocketGSError
from pocketgs.files.journal import KEPT
from pocketgs.files.lock import locked
from pocketgs.system.interrupt import deferred_interrupt

NEW, OLD = "new", "old"
"""In a temporary folder: the new content, and the earlier content that it replaces."""

RANDOM = "[a-z0-9_]" * 8
"""Pattern of what `mkdtemp` adds to a name. A `*` would also match the temporary folders of `NAME.v2` for `NAME`."""


@contextmanager
def replacing_folder(folder: Path) -> Iterator[tuple[Path, Path]]:
    """Yield an empty folder to write to, and a scratch folder; rename the first to `folder` when the block ends.

    If anything goes wrong in between, `folder` keeps its earlier content. If the process is killed while it moves the
    earlier content aside, the next writer moves it back.

    Raises:
        PocketGSError: the folder is a mount point, or the complete content cannot be moved there; it is kept beside the
            folder then. As `InUseError` if another process is writing the folder.
        OSError: the folder cannot be written.
    """
    folder = folder.resolve()
    if os.path.ismount(folder):
        found = "is a mount point, such as a volume of a container, and cannot be replaced"
        raise PocketGSError(f"{folder}: {found}; expected a folder in it, such as {folder / 'capture'}")
    made = [path for path in folder.parents if not path.exists()]
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        with locked(folder.with_name(f".{folder.name}.lock"), folder):
            _clear_leftovers(folder)
            yield from _replacing(folder)
    finally:
        with suppress(OSError):
            for path in made:
                path.rmdir()  # fails if the folder is not empty


def _replacing(folder: Path) -> Iterator[tuple[Path, Path]]:
    temporary = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", suffix=".partial", dir=folder.parent))
    try:
        staging, workspace = temporary / NEW, temporary / "work"
        staging.mkdir()
        workspace.mkdir()
        yield staging, workspace
        with deferred_interrupt():
            try:
                _swap(staging, folder, temporary / OLD)
            except OSError as error:
                kept, reason = _keep(staging, folder), error.strerror or error
                raise PocketGSError(f"{folder}: cannot be written ({reason}); the new content is in {kept}") from error
    finally:
        if not _is_half_swapped(temporary, folder):
            shutil.rmtree(temporary, ignore_errors=True)


def _clear_leftovers(folder: Path) -> None:
    """Delete what killed processes left beside `folder`, and restore content that they had moved aside."""
    for leftover in folder.parent.glob(f".{escape(folder.name)}.{RANDOM}.partial"):
        if _is_half_swapped(leftover, folder):
            os.replace(leftover / OLD, folder)
        shutil.rmtree(leftover, ignore_errors=True)


def _is_half_swapped(temporary: Path, folder: Path) -> bool:
    """Whether the earlier content of `folder` was moved aside and nothing has replaced it."""
    return (temporary / OLD).is_dir() and not os.path.lexists(folder)


def _keep(new: Path, folder: Path) -> Path:
    """Move complete content to a folder of its own beside the one that it cannot replace."""
    kept = folder.with_name(f"{folder.name}.{KEPT}{uuid.uuid4().hex[:8]}")
    os.replace(new, kept)
    return kept


def _swap(new: Path, folder: Path, old: Path) -> None:
    """Replace `folder` by `new`, and move its earlier content to `old`."""
    existed = folder.exists()
    if existed:
        os.replace(folder, old)
    try:
        os.replace(new, folder)
    except OSError:
        if existed:
            os.replace(old, folder)
        raise
