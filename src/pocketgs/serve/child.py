"""Child processes: starting them apart from the terminal, and ending them with all that they have started.

Those that must not go on without the server end by themselves when it is gone.
"""

from __future__ import annotations

import asyncio
import os
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

import psutil

GRACE = 20.0
"""Seconds that an interrupted run has to keep what was trained, and to end its own child processes."""

SECONDS_BETWEEN_LOOKS = 0.05
SECONDS_TO_NOTICE = 0.5
"""How long a process goes on at most after the one that it watches has ended, see `exit_when_gone`."""

ORPHANED = 3
"""Exit status of a process whose watched process has ended."""


async def start(arguments: Sequence[str], folder: Path) -> asyncio.subprocess.Process:
    """Start `python -m` with arguments. Ctrl-C in the server's terminal does not reach the process.

    Args:
        arguments: the module and what it is given.
        folder: the working directory; Python imports from it first, so nobody else may write to it.
    """
    apart = sys.platform == "win32"
    return await asyncio.create_subprocess_exec(
        sys.executable,
        "-m",
        *arguments,
        cwd=folder,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        start_new_session=not apart,
        creationflags=getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0) if apart else 0,
    )


def end(number: int, argument: str, grace: float = GRACE) -> None:
    """Ask a process to stop, as Ctrl-C does; after a while, kill it and what it has started. Blocks meanwhile.

    Args:
        number: of the process.
        argument: of its command. It tells the process from others, since numbers are used again; the time of its
            creation would not, since that changes when the system's clock is set.
        grace: seconds to wait before it is killed.
    """
    with suppress(psutil.Error):
        found = psutil.Process(number)
        if argument not in found.cmdline():
            return
        family = [found, *found.children(recursive=True)]
        found.terminate()
        if not _ends_within(found, grace):
            for each in family:
                with suppress(psutil.Error):
                    each.kill()
            _ends_within(found, GRACE)


def exit_when_gone(number: int) -> None:
    """Exit, without any cleanup, soon after another process has ended, even if that was killed.

    The other is watched, since not every system tells a process that its parent is gone. Reading standard input until
    it closes would tell, but on Windows, libraries that are loaded meanwhile may wait for the end of that read.

    Args:
        number: of the other process. It need not be the parent: in a virtual environment on Windows, a launcher is.
    """
    try:
        psutil.Process().create_time()
    except psutil.Error:  # processes cannot be looked at here, such as in a sandbox without /proc
        return
    try:
        other = psutil.Process(number)
    except psutil.NoSuchProcess:
        os._exit(ORPHANED)
    threading.Thread(target=_exit_after, args=(other,), daemon=True).start()


def _ends_within(process: psutil.Process, seconds: float) -> bool:
    """Whether a process ends in time. Unlike psutil's `wait`, this leaves the exit status to whoever started it."""
    deadline = time.monotonic() + seconds
    while _goes_on(process):
        if time.monotonic() >= deadline:
            return False
        time.sleep(SECONDS_BETWEEN_LOOKS)
    return True


def _exit_after(other: psutil.Process) -> None:
    while _goes_on(other):
        time.sleep(SECONDS_TO_NOTICE)
    os._exit(ORPHANED)


def _goes_on(process: psutil.Process) -> bool:
    """Whether a process has not ended. A zombie has; whoever started it has yet to ask for its exit status."""
    try:
        return bool(process.is_running() and process.status() != psutil.STATUS_ZOMBIE)
    except psutil.NoSuchProcess:
        return False
