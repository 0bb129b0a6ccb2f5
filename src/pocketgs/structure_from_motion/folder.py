"""The folder of a posed capture, and the record of its inputs."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

from pocketgs.capture.unposed import POSED_RECORD
from pocketgs.errors import PocketGSError
from pocketgs.files.written_files import WRITTEN, check_only_written, without_browser_files

IMAGES, MASKS, MODEL = "images", "masks", "sparse"


def read_record(folder: Path) -> dict[str, Any] | None:
    """Read the record of a posed capture's inputs; None if there is none."""
    try:
        record = json.loads((folder / POSED_RECORD).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return record if isinstance(record, dict) else None


def check_replaceable(folder: Path) -> None:
    """Check that a folder is empty, or an earlier posed capture without other files.

    Raises:
        PocketGSError: the folder holds something else.
    """
    if not os.path.lexists(folder):
        return
    if not folder.is_dir():
        raise PocketGSError(f"{folder}: is a file, expected a folder for the posed capture")
    record = read_record(folder)
    found = without_browser_files(path.name for path in folder.iterdir())
    foreign = found - {IMAGES, MASKS, MODEL, POSED_RECORD} if record is not None else found
    if foreign:
        raise PocketGSError(
            f"{folder}: holds {sorted(foreign)[0]}, expected an empty folder or an earlier result of pocketgs pose"
        )
    check_only_written(folder, (record or {}).get(WRITTEN))


def is_whole(folder: Path, record: dict[str, Any]) -> bool:
    """Whether a posed capture still has its files. Older records list only the images that were placed.

    Args:
        folder: of the capture.
        record: as `read_record` reads it.
    """
    placed = [f"{IMAGES}/{name}" for name in record.get("placed", ())]
    return (folder / MODEL).is_dir() and all((folder / name).is_file() for name in record.get(WRITTEN, placed))
