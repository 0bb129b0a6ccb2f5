"""The same work for many files, on several threads, told of as it goes on."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")

Count = Callable[[int, int], None]
"""Is told how much of a stage is done, and of how much."""


def each(items: Sequence[Item], work: Callable[[Item], Result], threads: int, on_count: Count) -> list[Result]:
    """What the work gives for each item, in their order; whatever it raises ends all of it.

    Args:
        items: to work on.
        work: lets other threads run, as decoding and OpenCV's functions do.
        threads: to work with.
        on_count: called by this thread after each.
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
