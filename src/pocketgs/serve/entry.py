"""What is known of one capture on the shelf, and its file `about.json`."""

from __future__ import annotations

import re
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal, TypeVar, get_args

from pocketgs.errors import PocketGSError
from pocketgs.files.json_fields import Fields, read_json

Kind = Literal["photographs", "video", "archive"]
State = Literal["uploading", "checking", "unusable", "queued", "training", "trained", "failed", "stopped"]
"""Uploading, then checking, then queued or unusable; queued, then training, then one of the last three."""

_Choice = TypeVar("_Choice", bound=str)

ID = re.compile(r"\d{8}-\d{6}-[0-9a-f]{6}")
STORED = re.compile(r"\d{4}\.[a-z0-9]{2,4}")


@dataclass(frozen=True)
class UploadedFile:
    """A file of a capture.

    Attributes:
        name: the user's, which is shown and compared, but never used as a path.
        stored: the server's: its name on disk.
        size: in bytes, when it is complete.
    """

    name: str
    stored: str
    size: int


@dataclass(frozen=True)
class Entry:
    """A capture on the shelf.

    Attributes:
        id: the name of its folder.
        title: the user's.
        kind: of its files.
        files: what was, or is to be, uploaded.
        effort: of training: of the last run, or the next one if there was none.
        anew: effort of the next run if that is to begin anew; empty if it goes on where the last one ended.
        created: when the upload began, in seconds since 1970, as all times here.
        state: see `State`.
        queued: when it was put into the queue.
        message: why it is unusable or has failed.
        begun: when its last run began; a run that goes on keeps it.
        flags: of the last run's command.
        process: number of the process that trains it, while one does.
        deleted: when it was moved to the trash; None outside it.
    """

    id: str
    title: str
    kind: Kind
    files: tuple[UploadedFile, ...]
    effort: str
    created: float
    state: State = "uploading"
    queued: float = 0.0
    message: str = ""
    anew: str = ""
    begun: float = 0.0
    flags: tuple[str, ...] = ()
    process: int | None = None
    deleted: float | None = None

    @property
    def bytes(self) -> int:
        """Size of all files, when they are complete."""
        return sum(file.size for file in self.files)

    def to_json(self) -> dict[str, Any]:
        """The content of `about.json`."""
        return asdict(self)


def read_entry(path: Path) -> Entry:
    """Read an `about.json`.

    Raises:
        PocketGSError: it cannot be read, or is not what `Entry.to_json` gives.
    """
    fields = read_json(path)
    process = fields.values.get("process")
    entry = Entry(
        id=fields.text("id"),
        title=fields.text("title"),
        kind=_one_of(fields, "kind", get_args(Kind)),
        files=tuple(
            UploadedFile(file.text("name"), file.text("stored"), int(file.number("size")))
            for file in fields.objects("files")
        ),
        effort=fields.text("effort"),
        created=fields.number("created"),
        state=_one_of(fields, "state", get_args(State)),
        queued=fields.number("queued"),
        message=str(fields.values.get("message", "")),
        anew=str(fields.values.get("anew", "")),
        begun=fields.number("begun"),
        flags=tuple(fields.optional_texts("flags") or ()),
        process=process if isinstance(process, int) else None,
        deleted=fields.optional_number("deleted"),
    )
    if entry.id != path.parent.name or not all(STORED.fullmatch(file.stored) for file in entry.files):
        raise PocketGSError(f"{path}: does not belong to its folder, expected one that pocketgs serve wrote")
    return entry


def _one_of(fields: Fields, name: str, choices: tuple[_Choice, ...]) -> _Choice:
    found = fields.text(name)
    for choice in choices:
        if found == choice:
            return choice
    raise PocketGSError(f"{fields.where}: field '{name}' is {found!r}, expected one of {', '.join(choices)}")
