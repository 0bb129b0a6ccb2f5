"""A file lock that ends with the process that holds it."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from pocketgs.errors import PocketGSError


class InUseError(PocketGSError):
    """Another process holds the lock."""


@contextmanager
def locked(path: Path, what: Path) -> Iterator[None]:
    """Hold a file lock while the block runs; the file exists only meanwhile.

    The operating system releases the lock when the process ends, however it ends. A killed process leaves the file
    behind, which does no harm.

    Args:
        path: the file, in an existing folder.
        what: the thing that is locked, for the error message.

    Raises:
        InUseError: another process, or this one, already holds the lock.
        OSError: the file cannot be created, or its file system has no locks.
    """
    descriptor = _acquire(path, what)
    try:
        yield
    finally:
        _release(descriptor, path)


def _acquire(path: Path, what: Path) -> int:
    while True:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
        try:
            if not _try_lock(descriptor):
                raise InUseError(f"{what}: another pocketgs process is writing there, expected it to end first")
            if _is_at(descriptor, path):
                return descriptor
        except BaseException:
            os.close(descriptor)
            raise
        # The previous holder has just released and deleted the file: the next process would create another.
        os.close(descriptor)


def _is_at(descriptor: int, path: Path) -> bool:
    """Whether `path` still names the open file."""
    with suppress(FileNotFoundError):
        return os.path.samestat(os.fstat(descriptor), os.stat(path))
    return False


if sys.platform == "win32":
    import msvcrt

    def _try_lock(descriptor: int) -> bool:
        try:
            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
        except OSError:
            return False
        return True

    def _release(descriptor: int, path: Path) -> None:
        # Windows cannot delete an open file: if this fails, another process is about to lock it.
        os.close(descriptor)
        with suppress(OSError):
            path.unlink()

else:
    import fcntl

    def _try_lock(descriptor: int) -> bool:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        return True

    def _release(descriptor: int, path: Path) -> None:
        # Delete while still locked: afterwards the file may be another process's.
        with suppress(OSError):
            if _is_at(descriptor, path):
                path.unlink()
        os.close(descriptor)
