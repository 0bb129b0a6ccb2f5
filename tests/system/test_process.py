"""Memory and age of this process, and times of stages."""

from __future__ import annotations

import subprocess
import sys
import time

import numpy as np
import pytest

from pocketgs.system.process import seconds_since_start
from pocketgs.system.stopwatch import Stopwatch

GROWTH = """
import numpy as np
from pocketgs.system.process import peak_rss_mb

before = peak_rss_mb()
held = np.ones(25_000_000)
print(peak_rss_mb() - before, held.sum())
"""


def test_peak_memory_grows_with_what_is_held() -> None:
    """In a process of its own: here, other tests may have held more before."""
    run = subprocess.run([sys.executable, "-c", GROWTH], capture_output=True, text=True, check=True)
    assert float(run.stdout.split()[0]) > 100


@pytest.mark.skipif(sys.platform != "linux", reason="other systems start a process's count at 0")
def test_peak_memory_is_not_that_of_the_parent() -> None:
    held = np.ones(50_000_000)
    program = "from pocketgs.system.process import peak_rss_mb; print(peak_rss_mb())"
    child = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert 5 < float(child.stdout) < 200
    assert held.sum() > 0


def test_stopwatch_adds_up_and_tells() -> None:
    told: list[str] = []
    stopwatch = Stopwatch(told.append)
    for name in ("one", "two", "one"):
        with stopwatch.stage(name):
            time.sleep(0.01)
    assert told == ["one", "two", "one"]
    assert stopwatch.seconds["one"] >= 0.02
    assert stopwatch.seconds["two"] >= 0.01
    assert seconds_since_start() > 0.03


def test_setting_the_clock_does_not_make_a_process_older(monkeypatch: pytest.MonkeyPatch) -> None:
    before, now = seconds_since_start(), time.time()
    monkeypatch.setattr(time, "time", lambda: now + 3600.0)
    assert before <= seconds_since_start() < before + 60.0
