"""What a run has left behind, and what it said."""

from __future__ import annotations

import re
from contextlib import suppress
from pathlib import Path
from typing import Any

from pocketgs.errors import PocketGSError
from pocketgs.files.json_fields import read_json
from pocketgs.results.checkpoint import CHECKPOINT, UNFINISHED
from pocketgs.results.folder import RECORD, SCENE
from pocketgs.serve.entry import Entry
from pocketgs.serve.shelf import CAPTURE, UPLOAD

LOOKED_FOR = " Looked for "
"""What follows is the list of files by which formats are recognised: longer than a phone's screen, no help there."""

NAME_IT = re.compile(r"\bname (that folder|one of them|one)$")
"""What a command asks for. A phone names no path: it sends what is asked for by itself."""


def is_complete(result: Path, begun: float) -> bool:
    """Whether a run that began at a time has come to its end."""
    record = record_of(result)
    return _time_of(result / RECORD) >= begun and record is not None and not record.get("interrupted")


def can_go_on(result: Path, begun: float) -> bool:
    """Whether a run that began at a time, 0 for none, has left a checkpoint to go on from."""
    newest = max(_time_of(result / name) for name in (UNFINISHED, CHECKPOINT))
    return begun > 0 and newest >= begun and not is_complete(result, begun)


def record_of(result: Path) -> dict[str, Any] | None:
    """The content of a result's `run.json`; None if there is no result."""
    with suppress(PocketGSError, OSError):
        if (result / SCENE).is_file():
            return read_json(result / RECORD).values
    return None


def plain_message(said: str, entry: Entry, place: Path) -> str:
    """What a command has said, with the user's names in place of paths on the server.

    Args:
        said: its last line.
        entry: the capture.
        place: its folder.
    """
    names = {place / UPLOAD / file.stored: file.name for file in entry.files}
    names |= {place / UPLOAD: entry.title, place / CAPTURE: entry.title, place: entry.title}
    for path, name in names.items():
        said = said.replace(str(path), name)
    return NAME_IT.sub(r"zip \1 alone", said.removeprefix("pocketgs: ").partition(LOOKED_FOR)[0])


def _time_of(path: Path) -> float:
    with suppress(OSError):
        return path.stat().st_mtime
    return 0.0
