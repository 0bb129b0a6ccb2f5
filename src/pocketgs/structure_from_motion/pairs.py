"""Which images to match: all of a few; of many those that look alike, stand near each other, or follow each other."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

import numpy as np

MAX_FOR_ALL_PAIRS = 45
"""All pairs of 45 images are 990."""

MAX_SIMILAR = 20
FOLLOWING = (1, 2, 3, 4, 6, 8)
MAX_NEARBY = 8

Pairs = set[tuple[int, int]]
"""Indices of images, the smaller first."""


def all_pairs(count: int, among: Iterable[int] | None = None) -> Pairs:
    """All pairs of so many images, or those that one of some images is in."""
    first = range(count) if among is None else among
    return {(min(i, j), max(i, j)) for i in first for j in range(count) if i != j}


def chosen_pairs(likeness: np.ndarray, in_order: bool, places: np.ndarray | None = None) -> Pairs:
    """Pairs that probably see the same.

    Args:
        likeness: (F, F), see `retrieval`.
        in_order: whether images were taken one after the other.
        places: (F, 3) metres, NaN where unknown, or None.
    """
    count = len(likeness)
    if count <= MAX_FOR_ALL_PAIRS:
        return all_pairs(count)
    pairs = _best(-likeness, MAX_SIMILAR)
    if in_order:
        pairs |= {(i, i + step) for step in FOLLOWING for i in range(count - step)}
    if places is not None:
        distances = np.linalg.norm(places[:, None] - places[None], axis=2)
        np.fill_diagonal(distances, np.inf)
        pairs |= _best(np.where(np.isfinite(distances), distances, np.inf), MAX_NEARBY)
    return pairs


def are_in_order(names: Sequence[str]) -> bool:
    """Whether names count up, as cameras name photographs: most numbers follow closely on the one before."""
    numbers = [int(found[-1]) for found in (re.findall(r"\d+", name) for name in names) if found]
    if len(numbers) < len(names) or len(names) < 2:
        return False
    steps = np.diff(np.array([float(number) for number in numbers]))
    # Seconds in names make large steps; what counts is that steps go up and are mostly alike.
    return bool(np.all(steps > 0) and np.median(steps) * 10 >= np.quantile(steps, 0.8))


def _best(costs: np.ndarray, most: int) -> Pairs:
    """Each image with those of least finite cost."""
    nearest = np.argsort(costs, axis=1, kind="stable")[:, :most]
    rows = np.repeat(np.arange(len(costs)), nearest.shape[1])
    chosen = zip(rows.tolist(), nearest.reshape(-1).tolist(), strict=True)
    return {(min(i, j), max(i, j)) for i, j in chosen if i != j and np.isfinite(costs[i, j])}
