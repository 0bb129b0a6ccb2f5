"""Returning freed memory to the system."""

from __future__ import annotations

import ctypes
from functools import cache


def give_back() -> None:
    """Return freed memory to the system if the C library is glibc, which would keep it.

    glibc keeps freed memory for reuse. The memory that one stage frees would then add to what the next one allocates,
    which raises the peak by a quarter and more.
    """
    library = _glibc()
    if library:
        library.malloc_trim(0)


@cache
def _glibc() -> ctypes.CDLL | None:
    try:
        library = ctypes.CDLL("libc.so.6")
    except OSError:  # not Linux, or another C library
        return None
    return library if hasattr(library, "malloc_trim") else None
