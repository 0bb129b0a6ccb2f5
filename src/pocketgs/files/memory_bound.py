"""A bound on the memory that reading a file may take. A few bytes can state or unpack to any amount, so readers check
before they allocate.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from pocketgs.errors import PocketGSError
from pocketgs.system.device import MB

DEFAULT_MB = 3000
JSON_BYTES = 30
"""Upper bound of the memory per byte of JSON: three characters can state an empty object."""

_most_bytes = DEFAULT_MB * MB


@contextmanager
def memory_bound(megabytes: int) -> Iterator[None]:
    """Bound the memory that reading may take while the block runs, in all threads.

    Args:
        megabytes: of 10^6 bytes.

    Raises:
        PocketGSError: the bound is less than 1 MB.
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
    """Check that reading something stays within the memory bound.

    Args:
        where: the file, for the message.
        needed: bytes that reading takes.
        what: what takes them, for the message.

    Raises:
        PocketGSError: it exceeds the bound.
    """
    if not fits(needed):
        megabytes = -(-needed // MB)
        raise PocketGSError(
            f"{where}: {what} would take {megabytes:,.0f} MB of memory, expected at most {_most_bytes // MB:,} MB: "
            f"--max-memory {megabytes:.0f} or more would be enough"
        )


def fits(needed: float) -> bool:
    """Whether reading something that takes `needed` bytes stays within the memory bound."""
    return needed <= _most_bytes


def room_for(needed: float, most: int, held: float = 0.0) -> int:
    """Number of items of `needed` bytes each that fit in the bound beside `held` bytes: at least 1, at most `most`."""
    return int(max(1, min(most, (_most_bytes - held) // max(needed, 1))))
