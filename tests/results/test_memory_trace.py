"""Memory over time: allocations are visible, and long runs keep few samples."""

from __future__ import annotations

import time
from itertools import pairwise

import numpy as np
import pytest

from pocketgs.results import memory_trace
from pocketgs.results.memory_trace import MemoryTrace


def wait_for(trace: MemoryTrace, samples: int) -> None:
    deadline = time.monotonic() + 30
    while len(trace.samples) < samples and time.monotonic() < deadline:
        time.sleep(0.005)


def test_what_is_allocated_shows_in_its_stage() -> None:
    stage = "before"
    with MemoryTrace(lambda: stage, interval=0.005) as trace:
        wait_for(trace, 3)
        block = np.ones(40_000_000)  # 320 MB
        stage = "after"
        wait_for(trace, len(trace.samples) + 3)
        del block
    assert trace.samples[0].stage == "before"
    after = max(sample.rss_mb for sample in trace.samples if sample.stage == "after")
    assert 300 < after - trace.samples[0].rss_mb < 400


def test_a_long_run_keeps_few_samples_spread_over_all_of_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(memory_trace, "MAX_SAMPLES", 16)
    with MemoryTrace(lambda: "", interval=0.002) as trace:
        first = trace.samples[0] if trace.samples else None
        time.sleep(0.3)
    assert 2 <= len(trace.samples) <= 16
    assert first is None or trace.samples[0] == first
    seconds = [sample.seconds for sample in trace.samples]
    assert all(earlier <= later for earlier, later in pairwise(seconds))
    assert seconds[-1] - seconds[0] > 0.1


def test_it_ends_with_the_block_and_lets_errors_through() -> None:
    with pytest.raises(ValueError, match="mine"), MemoryTrace(lambda: "", interval=0.002) as trace:
        raise ValueError("mine")
    count = len(trace.samples)
    time.sleep(0.05)
    assert len(trace.samples) == count
