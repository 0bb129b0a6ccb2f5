"""Writing a piece of an upload to disk."""

from __future__ import annotations

import os
import stat
from pathlib import Path

from pocketgs.serve.refused import RefusedError

MAX_PIECE = 1 << 22
"""Most bytes that one request may bring: they are in memory before they are written."""

_NO_LINKS = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_BINARY", 0)


def put_piece(path: Path, size: int, offset: int, piece: bytes) -> int:
    """Append a piece to a file. It may begin before the file's end; what was there before must be the same then.

    So a piece whose response was lost can be sent again, and a page that continues an upload shows by the overlap that
    it has the same file.

    Args:
        path: the file, in a real folder; created if needed.
        size: of the complete file.
        offset: position of the piece in the file.
        piece: its bytes.

    Returns:
        The new length of the file.

    Raises:
        RefusedError: there is a gap before the piece, or it goes beyond the end, or differs from what was there.
        OSError: it cannot be written, such as on a full disk; the file is as before.
    """
    if offset + len(piece) > size:
        raise RefusedError(413, f"more bytes than the {size:,} that were stated for this file")
    if path.parent.resolve() != path.parent:
        raise RefusedError(409, "a link has taken the place of the capture's folder")
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT | _NO_LINKS, 0o666)
    with os.fdopen(descriptor, "r+b", buffering=0) as file:
        found = os.fstat(descriptor)
        if not stat.S_ISREG(found.st_mode):
            raise RefusedError(409, "something that is no file has taken the file's place")
        length = found.st_size
        if offset > length:
            raise RefusedError(409, f"{length:,} bytes have arrived so far", received=length)
        file.seek(offset)
        known = min(len(piece), length - offset)
        if file.read(known) != piece[:known]:
            raise RefusedError(409, "this is not the file that was being uploaded: its beginning differs")
        try:
            _write(descriptor, piece[known:])
        except OSError:
            os.ftruncate(descriptor, length)
            raise
        return max(length, offset + len(piece))


def _write(descriptor: int, rest: bytes) -> None:
    left = memoryview(rest)
    while left:
        left = left[os.write(descriptor, left) :]
