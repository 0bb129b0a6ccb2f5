"""Folders that a command replaces as a whole: it lists what it wrote there, so that nobody else's files are deleted."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path, PurePosixPath

from pocketgs.errors import PocketGSError
from pocketgs.files.manifest import files_below

WRITTEN = "written"
"""Key of the list in the record of a folder: paths in it with forward slashes."""

OF_FILE_BROWSERS = frozenset({".ds_store", "thumbs.db", "desktop.ini"})
"""Files that file browsers leave in the folders that they show, in lower case. They count as nobody's, and so do those
that macOS adds on disks of other systems, whose names begin with "._"."""


def without_browser_files(names: Iterable[str]) -> set[str]:
    """The names or paths without those of files that file browsers leave."""
    files = {name: PurePosixPath(name).name.lower() for name in names}
    return {name for name, file in files.items() if file not in OF_FILE_BROWSERS and not file.startswith("._")}


def check_only_written(folder: Path, written: object) -> None:
    """Check that a folder holds no files but those that were written there.

    Args:
        folder: to be replaced.
        written: the list from its record; None, or anything but a list, passes, since older records have no list.

    Raises:
        PocketGSError: it holds another file.
    """
    if not isinstance(written, list):
        return
    if foreign := without_browser_files(files_below(folder)) - set(map(str, written)):
        raise PocketGSError(
            f"{folder / min(foreign)}: was not written by pocketgs, and would be deleted with its folder; move it "
            "away, or choose another folder"
        )
