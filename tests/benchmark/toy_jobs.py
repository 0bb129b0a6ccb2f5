"""Cells that are quick to run, and results of them."""

from __future__ import annotations

import sys
import time
from dataclasses import asdict
from pathlib import Path

import pytest

from pocketgs.benchmark.captures import BenchCapture
from pocketgs.benchmark.cell import Job
from pocketgs.benchmark.conditions import present_conditions
from pocketgs.benchmark.methods import METHODS
from pocketgs.benchmark.results import CellResult

ON_POSIX = pytest.mark.skipif(sys.platform == "win32", reason="signals are others there")

COMMON = ("--effort", "quick", "--iterations", "10", "--evaluate-every", "5", "--engine", "cpu")
QUICK = ("--iterations", "12", "--evaluate-every", "4", "--engine", "cpu", "--max-gaussians", "1000")


def job(capture: Path, method: str = "pocketgs", seed: int = 0, flags: tuple[str, ...] = QUICK) -> Job:
    return Job(METHODS[method], BenchCapture(capture.name, capture), seed, flags)


def result_of(done: Job, seconds: float = 10.0, error: str | None = None) -> CellResult:
    conditions = asdict(present_conditions(done.common_flags))
    return CellResult(done.cell, done.command, error, seconds, files=done.capture.files, **conditions)


def wait_for(word: str, log: Path) -> None:
    """Wait until a log holds a word."""
    deadline = time.monotonic() + 300
    while not (log.is_file() and word in log.read_text()):
        assert time.monotonic() < deadline, f"{log} never said {word!r}"
        time.sleep(0.05)
