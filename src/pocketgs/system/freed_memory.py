"""Giving memory that has been freed back to the system."""

from __future__ import annotations

import ctypes
from functools import cache


def give_back() -> None:
    """Return freed memory to the system, where its C library, glibc, would keep it.

    glibc keeps what was freed in case it is asked for again. What one stage of a run has freed would thus add to what
    the next one takes, by a quarter of the run's peak and more.
    """
    library = _glibc()
    if library:
        library.malloc_trim(0)


@cache
def _glibc() -> ctypes.CDLL | None:
    try:
        library = ctypes.CDLL("libc.so.6")
    except OSError:  # another system, or another C library
        return None
    return library if hasattr(library, "malloc_trim") else None
