"""How much memory a file may ask for. A few bytes of it can state or unpack to any amount, so what it needs is known
and compared before it is allocated.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from pocketgs.errors import PocketGSError

MB = 1_000_000
DEFAULT_MB = 3000
JSON_BYTES = 30
"""Memory for each byte of JSON at most: three characters can state an empty object."""

_most_bytes = DEFAULT_MB * MB


@contextmanager
def memory_bound(megabytes: int) -> Iterator[None]:
    """Bound what reading may take while the block runs, in all threads: memory is the process's.

    Args:
        megabytes: of 10^6 bytes.

    Raises:
        PocketGSError: there are none.
    """
    if megabytes < 1:
        raise PocketGSError(f"max memory: found {megabytes}, expected at least 1")
    global _most_bytes
    before, _most_bytes = _most_bytes, megabytes * MB
    try:
        yield
    finally:
        _most_bytes = before


def require_memory(where: object, needed: float, what: str) -> None:
    """Refuse what would take more memory than there may be.

    Args:
        where: the file, for the message.
        needed: bytes that it takes while it is read.
        what: asks for them, in words, for the message.

    Raises:
        PocketGSError: it is more than the bound.
    """
    if needed > _most_bytes:
        megabytes = -(-needed // MB)
        raise PocketGSError(
            f"{where}: {what} would take {megabytes:,.0f} MB of memory, expected at most {_most_bytes // MB:,} MB: "
            f"--max-memory {megabytes:.0f} or more would do"
        )


def room_for(needed: float, most: int) -> int:
    """How many things that take so many bytes each fit at the same time: at least 1, at most `most`."""
    return int(max(1, min(most, _most_bytes // max(needed, 1))))
