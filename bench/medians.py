"""Median times of functions, for the other benchmarks."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable


def median_milliseconds(work: Callable[[], object], repeats: int) -> float:
    """Median time of some calls in milliseconds. What compiles or allocates at first is to be called before."""
    durations = []
    for _ in range(repeats):
        started = time.perf_counter()
        work()
        durations.append(1000 * (time.perf_counter() - started))
    return statistics.median(durations)
