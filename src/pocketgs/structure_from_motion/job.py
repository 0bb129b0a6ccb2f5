"""The child process of a job for COLMAP: the job as JSON on stdin; on stdout lines of JSON: stages, counts, outcome.

Why a process of its own: pycolmap brings copies of libraries such as zlib, which crash Pillow when both are loaded; its
memory is given back before training begins; and whatever stops it cannot stop the program that asked.
"""

from __future__ import annotations

import json
import signal
import sys
from collections.abc import Callable
from typing import Any

Job = dict[str, Any]
Outcome = dict[str, Any]


def announce(stage: str) -> None:
    """Tell the parent process that a stage begins."""
    print(json.dumps({"stage": stage}), flush=True)


def announce_count(done: int, of: int) -> None:
    """Tell the parent process how much of the stage is done."""
    print(json.dumps({"done": done, "of": of}), flush=True)


def serve(run: Callable[[Job], Outcome]) -> None:
    """Run the job that stdin states, and tell its outcome."""
    # Ctrl-C reaches both processes of a terminal: the parent decides.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    print(json.dumps({"outcome": run(json.load(sys.stdin))}), flush=True)
