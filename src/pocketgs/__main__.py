"""Entry point of `pocketgs` and `python -m pocketgs`. Handles Ctrl-C before the slow imports start."""

from __future__ import annotations

import os
import sys
from contextlib import suppress
from types import FrameType

from pocketgs.system.interrupt import STOPPED, listen, raise_interrupt, raise_lost_interrupts


def main() -> None:
    """Run the command line. Ctrl-C at any time ends it with one line."""
    listen(_stop_at_once)
    raise_lost_interrupts()
    from pocketgs.cli import main as run

    status: object = 0
    try:
        try:
            listen(raise_interrupt)
            run()
        except SystemExit as end:
            status = end.code
        finally:
            # Only Python's own cleanup is left; Ctrl-C there would print a traceback.
            listen(_stop_at_once)
    except KeyboardInterrupt:  # pressed again while the first was being handled
        _stop_at_once()
    if status == STOPPED:
        _leave()
    sys.exit(status)  # type: ignore[arg-type]


def _stop_at_once(number: int = 0, frame: FrameType | None = None) -> None:
    """Exit without cleanup: nothing has started yet, or everything has ended."""
    os.write(2, b"pocketgs: stopped\n")
    os._exit(STOPPED)


def _leave() -> None:
    """Exit without Python's cleanup.

    If Ctrl-C was pressed twice, other threads may still be working, and cleanup would abort the process beneath them.
    """
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError, AttributeError):  # closed, on a full disk, or none, as in pythonw
            stream.flush()
    os._exit(STOPPED)


if __name__ == "__main__":
    main()
