"""The place of a file that a command will write after long work."""

from __future__ import annotations

from pathlib import Path

from pocketgs.errors import PocketGSError


def check_place(output: Path) -> None:
    """Refuse a place where no file can be written, before the work.

    Raises:
        PocketGSError: it is a folder, or in a folder that does not exist.
    """
    if output.is_dir() or not output.parent.is_dir():
        found = "is a folder" if output.is_dir() else "its folder does not exist"
        raise PocketGSError(f"{output}: {found}, expected the name of a file in an existing folder")
