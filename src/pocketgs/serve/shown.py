"""What the page is told about the shelf."""

from __future__ import annotations

import time
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import Any

from pocketgs.errors import PocketGSError
from pocketgs.files.json_fields import read_json
from pocketgs.results.folder import RECORD, SCENE
from pocketgs.serve.entry import Entry
from pocketgs.serve.outcome import can_go_on
from pocketgs.serve.queue import Queue
from pocketgs.serve.shelf import RESULT, THUMBNAIL, Shelf

SECONDS_ACTIVE = 10.0
"""How long after its last piece an upload counts as going on."""


def shown_entry(shelf: Shelf, queue: Queue, entry: Entry, last_piece: float) -> dict[str, Any]:
    """What the page is told about a capture.

    Args:
        shelf: that it stands on.
        queue: that it may wait in.
        entry: the capture.
        last_piece: when the last piece of its upload arrived, by the monotonic clock.
    """
    place = shelf.place(entry)
    result = _result_of(place / RESULT)
    told: dict[str, Any] = {
        "id": entry.id,
        "title": entry.title,
        "kind": entry.kind,
        "count": len(entry.files),
        "bytes": entry.bytes,
        "effort": entry.effort,
        "created": entry.created,
        "state": entry.state,
        "message": entry.message,
        "thumbnail": _time_of(place / THUMBNAIL),
        "result": result,
        "can_go_on": (result is None or bool(result["interrupted"])) and can_go_on(place / RESULT, entry.begun),
    }
    if entry.state == "uploading":
        told["received"] = sum(shelf.received(entry))
        told["active"] = time.monotonic() - last_piece < SECONDS_ACTIVE
    elif entry.state == "queued":
        told["place"] = [each.id for each in queue.waiting()].index(entry.id) + 1
    elif run := queue.running(entry.id):
        told["progress"] = run.progress
        told["live"] = run.address is not None
    return told


def shown_files(shelf: Shelf, entry: Entry) -> list[dict[str, Any]]:
    """What the page is told about the files of an upload, to go on with it."""
    return [
        {"number": number, "name": file.name, "size": file.size, "received": received}
        for number, (file, received) in enumerate(zip(entry.files, shelf.received(entry), strict=True), start=1)
    ]


def shown_deleted(entry: Entry) -> dict[str, Any]:
    """What the page is told about a capture in the trash."""
    return {"id": entry.id, "title": entry.title, "deleted": entry.deleted}


def _result_of(result: Path) -> dict[str, Any] | None:
    with suppress(PocketGSError, OSError):
        return _figures_of(result, *((result / name).stat().st_mtime_ns for name in (RECORD, SCENE)))
    return None


@lru_cache(256)
def _figures_of(result: Path, recorded: int, written: int) -> dict[str, Any]:
    """The figures of a result; kept until the next one is written.

    That there is none is an error and so is not kept: files of a new result come one after the other.

    Args:
        result: its folder.
        recorded: when its record was written.
        written: when its scene was.

    Raises:
        PocketGSError: the record cannot be read.
        OSError: there is no scene.
    """
    record = read_json(result / RECORD).values
    told = {name: record.get(name) for name in ("psnr", "iterations", "gaussians", "interrupted")}
    return {**told, "bytes": (result / SCENE).stat().st_size}


def _time_of(path: Path) -> int | None:
    """When a file was last written, in milliseconds; None if there is none."""
    with suppress(OSError):
        return path.stat().st_mtime_ns // 1_000_000
    return None
