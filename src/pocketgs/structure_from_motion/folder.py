"""The folder of a posed capture, and the record of its inputs."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

from pocketgs.capture.formats.colmap import POSED_RECORD
from pocketgs.errors import PocketGSError

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
    found = {path.name for path in folder.iterdir()}
    foreign = found - {IMAGES, MASKS, MODEL, POSED_RECORD} if read_record(folder) is not None else found
    if foreign:
        raise PocketGSError(
            f"{folder}: holds {sorted(foreign)[0]}, expected an empty folder or an earlier result of pocketgs pose"
        )
