"""Atomic file writes."""

from __future__ import annotations

import os
import uuid
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from glob import escape
from pathlib import Path

from pocketgs.errors import PocketGSError

RANDOM_DIGITS = 8
"""Of the hexadecimal number in the name of a temporary file."""

MAX_NAME_BYTES = 255
"""Longest file name on the usual file systems."""


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield a temporary path beside `path`, with its suffix; rename it to `path` when the block ends.

    If anything goes wrong in between, even if the process is killed, `path` keeps its earlier content.

    Raises:
        PocketGSError: the folder does not exist or cannot be written to, or `path` names no file.
    """
    if not path.name:
        raise PocketGSError(f"{path}: is a folder, expected the name of a file")
    partial = path.with_name(f".{_short_stem(path)}.{uuid.uuid4().hex[:RANDOM_DIGITS]}.partial{path.suffix}")
    try:
        yield partial
        # The rename may reach the disk before the content: a power cut would leave an empty file.
        with partial.open("rb+") as file:
            os.fsync(file.fileno())
        os.replace(partial, path)
    except OSError as error:
        raise PocketGSError(f"{path}: cannot be written ({error.strerror or error})") from error
    finally:
        # Where nothing can be written, the lookup may fail too: it must not hide the error above.
        with suppress(OSError):
            partial.unlink()


def remove_leftovers(path: Path) -> None:
    """Delete the temporary files that killed processes have left beside `path`."""
    digits = "[0-9a-f]" * RANDOM_DIGITS  # a * would also match the temporary files of NAME.v2 for NAME
    for leftover in path.parent.glob(f".{escape(_short_stem(path))}.{digits}.partial{escape(path.suffix)}"):
        leftover.unlink(missing_ok=True)


def _short_stem(path: Path) -> str:
    """The part of a file's stem that the names of its temporary files begin with: the names may be no longer."""
    stem, rest = path.stem, f"..{'0' * RANDOM_DIGITS}.partial{path.suffix}"
    while stem and len(os.fsencode(stem + rest)) > MAX_NAME_BYTES:
        stem = stem[:-1]
    return stem
