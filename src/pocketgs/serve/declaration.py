"""What a page says that it will upload: checked before a byte of it is taken."""

from __future__ import annotations

import time
import unicodedata
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import Any

from pocketgs.capture.decoding.video_file import VIDEO_SUFFIXES
from pocketgs.capture.unposed import by_number
from pocketgs.files.paths import IMAGE_SUFFIXES
from pocketgs.serve.entry import Entry, Kind, UploadedFile
from pocketgs.serve.refused import RefusedError
from pocketgs.serve.shelf import new_id

SUFFIXES: dict[Kind, frozenset[str]] = {
    "photographs": IMAGE_SUFFIXES,
    "video": VIDEO_SUFFIXES,
    "archive": frozenset({".zip", ".r3d"}),
}
"""The suffixes of each kind of upload, in lower case."""

FEWEST_PHOTOGRAPHS, MOST_PHOTOGRAPHS = 3, 2000
MAX_TITLE, MAX_NAME = 100, 255


@dataclass(frozen=True)
class Bounds:
    """The bounds of an upload.

    Attributes:
        bytes: of all files of a capture together, and of what an archive unpacks to.
        efforts: that a run may have.
    """

    bytes: int
    efforts: Collection[str]


def declared(said: Any, bounds: Bounds) -> Entry:
    """The capture that a page wants to upload.

    Args:
        said: parsed JSON: `title`, `effort` and `files`, each of these with `name` and `size`.
        bounds: of the upload.

    Raises:
        RefusedError: it is of wrong types, too large, or nothing that can be trained.
    """
    files = said.get("files") if isinstance(said, dict) else None
    if not isinstance(files, list) or not files:
        raise RefusedError(400, "expected a list of files to upload")
    if len(files) > MOST_PHOTOGRAPHS:
        raise RefusedError(413, f"{len(files):,} files, expected at most {MOST_PHOTOGRAPHS:,}")
    named = sorted((_file(file) for file in files), key=lambda file: by_number(file[0]))
    kind = _kind([name for name, _ in named])
    total = sum(size for _, size in named)
    if total > bounds.bytes:
        raise RefusedError(413, f"{_megabytes(total)} to upload, expected at most {_megabytes(bounds.bytes)}")
    stored = [
        UploadedFile(name, f"{number:04d}{_suffix(name)}", size) for number, (name, size) in enumerate(named, start=1)
    ]
    title, effort = clean_title(said.get("title")), checked_effort(said.get("effort"), bounds)
    return Entry(new_id(), title, kind, tuple(stored), effort, time.time())


def clean_title(said: Any) -> str:
    """A title in one line, without control characters.

    Raises:
        RefusedError: it is empty, too long or no text.
    """
    if not isinstance(said, str):
        raise RefusedError(400, "expected a title")
    title = " ".join("".join(" " if unicodedata.category(each) == "Cc" else each for each in said).split())
    if not title or len(title) > MAX_TITLE or not _is_text(title):
        raise RefusedError(400, f"expected a title of 1 to {MAX_TITLE} characters")
    return title


def checked_effort(said: Any, bounds: Bounds) -> str:
    """An effort that the server offers.

    Raises:
        RefusedError: it offers no such.
    """
    if not isinstance(said, str) or said not in bounds.efforts:
        raise RefusedError(400, f"expected one of the efforts {', '.join(bounds.efforts)}")
    return said


def _file(said: Any) -> tuple[str, int]:
    name, size = (said.get("name"), said.get("size")) if isinstance(said, dict) else (None, None)
    if not isinstance(name, str) or not 0 < len(name) <= MAX_NAME or not _is_text(name):
        raise RefusedError(400, f"expected names of files of 1 to {MAX_NAME} characters")
    if not isinstance(size, int) or isinstance(size, bool) or size < 0:
        raise RefusedError(400, f"{name}: expected its size in bytes")
    if size == 0:
        raise RefusedError(415, f"{name} is empty")
    return name, size


def _kind(names: list[str]) -> Kind:
    """The kind of an upload: photographs, one video, or one archive."""
    kinds: set[Kind] = set()
    for name in names:
        kind = next((kind for kind, suffixes in SUFFIXES.items() if _suffix(name) in suffixes), None)
        if kind is None:
            raise RefusedError(415, f"{name} is no photograph, video or zip file")
        kinds.add(kind)
    if len(kinds) > 1 or (kinds != {"photographs"} and len(names) > 1):
        raise RefusedError(415, "expected photographs, or one video, or one zip file")
    if kinds == {"photographs"} and len(names) < FEWEST_PHOTOGRAPHS:
        raise RefusedError(415, f"expected at least {FEWEST_PHOTOGRAPHS} photographs; 30 or more are better")
    return kinds.pop()


def _suffix(name: str) -> str:
    return PurePosixPath(name).suffix.lower()


def _is_text(said: str) -> bool:
    """Whether a string can be encoded: JSON may hold halves of surrogate pairs."""
    return not any("\ud800" <= each <= "\udfff" for each in said)


def _megabytes(count: int) -> str:
    return f"{count // 1_000_000:,} MB"
