"""Where the header of a .ply file ends."""

from __future__ import annotations

import re

MAX_HEADER_BYTES = 1 << 20

_END = re.compile(rb"(?<=[\r\n])end_header(?=[\r\n]|\Z)")


def header_in(start: bytes) -> bytes | None:
    """The header that a file starts with, up to the line that ends it; None if there is no such line.

    Comments may contain that line's word.
    """
    end = _END.search(start)
    return start[: end.start()] if end else None
