"""Parallel work on many files, with progress reports."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")

Count = Callable[[int, int], None]
"""Callback for progress: called with the number done and the total."""


def each(items: Sequence[Item], work: Callable[[Item], Result], threads: int, on_count: Count) -> list[Result]:
    """Apply `work` to each item in parallel and return the results in order; an exception stops all.

    Args:
        items: to work on.
        work: releases the GIL, as decoding and OpenCV's functions do.
        threads: number of threads.
        on_count: called from this thread after each item.
    """
    results = []
    with ThreadPoolExecutor(threads) as workers:
        try:
            for result in workers.map(work, items):
                results.append(result)
                on_count(len(results), len(items))
        except BaseException:
            workers.shutdown(wait=False, cancel_futures=True)
            raise
    return results
