"""Running COLMAP in child processes; see `pocketgs.structure_from_motion.colmap.job` for the reasons."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, suppress
from importlib.util import find_spec
from pathlib import Path
from queue import Empty, Queue
from threading import Thread
from typing import Any

from pocketgs.errors import PocketGSError
from pocketgs.files.memory_bound import room_for
from pocketgs.structure_from_motion.work import Count
from pocketgs.system.cores import usable_cores
from pocketgs.system.free_memory import free_memory
from pocketgs.system.process import resident_bytes

# Measured for SIFT, which first doubles the image's size.
BYTES_PER_PIXEL_AND_THREAD = 300

ALMOST_NOTHING = 10_000_000
"""Free bytes of a full disk: a write that fails leaves some."""


def check_installed() -> None:
    """Check that pycolmap is installed, without loading it.

    Raises:
        PocketGSError: it is not installed.
    """
    if find_spec("pycolmap") is None:
        raise PocketGSError(
            "poses of photographs are found by COLMAP, whose package pycolmap is not installed: pip install "
            "'pycolmap>=4.2' (it is built for Linux and Windows on x86-64 and for macOS 14 or later on Apple silicon), "
            "or find poses on such a machine with pocketgs pose and bring the folder here"
        )


def threads_that_fit(pixels: int) -> int:
    """Number of threads that can extract features from images of so many pixels, at least one.

    They fit in half of the free memory, and beside what this process holds in the memory bound.
    """
    needed = BYTES_PER_PIXEL_AND_THREAD * max(1, pixels)
    fitting = int(free_memory() / 2 // needed)
    return max(1, min(fitting, room_for(needed, usable_cores(), held=resident_bytes())))


def run_colmap(
    module: str,
    job: Mapping[str, Any],
    log: Path,
    on_stage: Callable[[str], None],
    on_count: Count = lambda done, of: None,
) -> dict[str, Any]:
    """Run a job and return its result.

    Args:
        module: of `colmap/`, whose `run` does the job: "verify_and_map" or "triangulation".
        job: what the module's `run` takes.
        log: file for COLMAP's stderr, in a folder of this program's own.
        on_stage: called with a stage's name when it begins.
        on_count: called with the progress of the stage.

    Raises:
        PocketGSError: COLMAP failed or was killed.
    """
    with _Run(module, log) as run:
        for message in run.messages(job):
            if "stage" in message:
                on_stage(message["stage"])
            if "done" in message:
                on_count(message["done"], message["of"])
        return run.outcome()


def run_side_by_side(
    module: str, jobs: Sequence[Mapping[str, Any]], folder: Path, on_done: Callable[[int], None]
) -> list[dict[str, Any]]:
    """Run jobs at the same time, each in a process of its own. If one fails, the others are stopped.

    Args:
        module: of `colmap/`, whose `run` does the jobs: "matching".
        jobs: what the module's `run` takes.
        folder: for COLMAP's stderr, of this program's own.
        on_done: called with the sum of what the jobs have done.

    Returns:
        The jobs' results.

    Raises:
        PocketGSError: COLMAP failed or was killed.
    """
    arrived: Queue[tuple[int, dict[str, Any] | None]] = Queue()

    def follow(number: int, run: _Run) -> None:
        try:
            for message in run.messages(jobs[number]):
                arrived.put((number, message))
        finally:
            arrived.put((number, None))

    done = [0] * len(jobs)
    outcomes: dict[int, dict[str, Any]] = {}
    with ExitStack() as running:
        runs = [running.enter_context(_Run(module, folder / f"log_{number}.txt")) for number in range(len(jobs))]
        for number, run in enumerate(runs):
            Thread(target=follow, args=(number, run), daemon=True).start()
        while len(outcomes) < len(jobs):
            try:
                number, message = arrived.get(timeout=1)  # on Windows, Ctrl-C waits for it
            except Empty:
                continue
            if message is None:
                outcomes[number] = runs[number].outcome()
            elif "done" in message:
                done[number] = message["done"]
                on_done(sum(done))
    return [outcomes[number] for number in range(len(jobs))]


def _full_disk(folder: Path) -> str:
    """What to add to a failure's message if a folder's disk is full, which COLMAP does not say; else nothing."""
    free = shutil.disk_usage(folder).free
    if free >= ALMOST_NOTHING:
        return ""
    return f": the disk that holds {folder.resolve()} is full ({free / 1e6:.1f} MB are free), expected more room there"


class _Run:
    """The process of a job, as a context: an exception that leaves it ends the process."""

    def __init__(self, module: str, log: Path) -> None:
        self._log, self._outcome = log, None
        # Relative places are meant from here, not from the child's folder.
        places = map(os.path.abspath, filter(None, os.environ.get("PYTHONPATH", "").split(os.pathsep)))
        with log.open("w", encoding="utf-8") as errors:
            self._process = subprocess.Popen(
                [sys.executable, "-m", f"{__package__}.colmap.{module}"],
                cwd=log.parent,  # Python imports from the working folder first, which may be an untrusted download
                env={**os.environ, "PYTHONPATH": os.pathsep.join(places)},
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=errors,
                encoding="utf-8",
            )

    def __enter__(self) -> _Run:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is not None:
            self._process.kill()
        self._process.wait()

    def messages(self, job: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
        """Start the job, and yield what its process says until it ends."""
        assert self._process.stdin
        assert self._process.stdout
        with suppress(OSError), self._process.stdin as given:  # a process that has ended has left a log
            json.dump(job, given)
        with self._process.stdout as said:
            for line in said:
                message = json.loads(line)
                self._outcome = message.get("outcome")
                yield message

    def outcome(self) -> dict[str, Any]:
        """The job's result, after its last message."""
        if self._process.wait() != 0 or self._outcome is None:
            said = self._log.read_text(encoding="utf-8", errors="replace").split("\n")
            status = f"status {self._process.returncode}"
            reason = next((line for line in reversed(said) if line.strip()), status)
            raise PocketGSError(f"COLMAP failed ({reason.strip()}){_full_disk(self._log.parent)}")
        return dict(self._outcome)
