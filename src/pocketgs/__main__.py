"""The command `pocketgs`, and `python -m pocketgs`: Ctrl-C is heard before anything that takes long is loaded."""

from __future__ import annotations

import os
import sys
from types import FrameType

from pocketgs.system.interrupt import STOPPED, listen, raise_interrupt


def main() -> None:
    """Run the command line, and exit in one line whenever Ctrl-C is pressed."""
    listen(_stop_at_once)
    from pocketgs.cli import main as run

    status: object = 0
    try:
        try:
            listen(raise_interrupt)
            run()
        except SystemExit as end:
            status = end.code
        finally:
            # Nothing but Python's own tidying is left, which would answer Ctrl-C with a traceback.
            listen(_stop_at_once)
    except KeyboardInterrupt:  # pressed again while the first was being dealt with
        _stop_at_once()
    sys.exit(status)  # type: ignore[arg-type]


def _stop_at_once(number: int = 0, frame: FrameType | None = None) -> None:
    """End without tidying up: nothing has been begun yet, or all has been ended."""
    os.write(2, b"pocketgs: stopped\n")
    os._exit(STOPPED)


if __name__ == "__main__":
    main()
