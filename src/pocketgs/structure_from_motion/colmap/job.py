"""The child process of a COLMAP job. Protocol: the job as JSON on stdin; stages, counts and result as JSON on stdout.

Reasons for a separate process: pycolmap bundles libraries such as zlib that crash Pillow when both are loaded; its
memory is released before training; and a crash does not end the main program.
"""

from __future__ import annotations

import json
import signal
import sys
from collections.abc import Callable, Mapping
from typing import Any


def announce(stage: str) -> None:
    """Report to the parent process that a stage begins."""
    print(json.dumps({"stage": stage}), flush=True)


def announce_count(done: int, of: int) -> None:
    """Report the progress of a stage to the parent process."""
    print(json.dumps({"done": done, "of": of}), flush=True)


def serve(run: Callable[[Any], Mapping[str, Any]]) -> None:
    """Run the job from stdin, and write its result to stdout."""
    # Ctrl-C reaches both processes of a terminal: the parent decides what to do.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    print(json.dumps({"outcome": run(json.load(sys.stdin))}), flush=True)
