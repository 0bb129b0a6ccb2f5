"""A lock that dies with the process that holds it."""

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
    """Hold the lock that a file stands for; the file is there only meanwhile.

    The operating system drops the lock when the process ends, however it ends. Somebody who is killed leaves the file,
    which means nothing by itself.

    Args:
        path: the file, in an existing folder.
        what: is locked, for the error's message.

    Raises:
        InUseError: another process, or this one, holds it already.
        OSError: the file cannot be made, or its file system knows no locks.
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
        # Its holder has just released the lock and deleted the file: whoever comes next would make another one.
        os.close(descriptor)


def _is_at(descriptor: int, path: Path) -> bool:
    """Whether the open file is the one that a path names now."""
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
        # Windows deletes no file that anybody has open: if this fails, another process is about to lock it.
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
        # Deleted while it is still locked: afterwards it might be another process's.
        with suppress(OSError):
            if _is_at(descriptor, path):
                path.unlink()
        os.close(descriptor)
