"""Choosing image pairs to match: all pairs of a few images; else those that are similar, near, or consecutive."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

import numpy as np

MAX_FOR_ALL_PAIRS = 45
"""Maximum number of images to match exhaustively: 45 images have 990 pairs."""

MAX_SIMILAR = 20
FOLLOWING = (1, 2, 3, 4, 6, 8)
MAX_NEARBY = 8

Pairs = set[tuple[int, int]]
"""Pairs of image indices, the smaller first."""


def all_pairs(count: int, among: Iterable[int] | None = None) -> Pairs:
    """All pairs of `count` images, or only those with an image in `among`."""
    first = range(count) if among is None else among
    return {(min(i, j), max(i, j)) for i in first for j in range(count) if i != j}


def chosen_pairs(likeness: np.ndarray, in_order: bool, places: np.ndarray | None = None) -> Pairs:
    """Pairs that probably overlap.

    Args:
        likeness: (F, F), see `retrieval`.
        in_order: whether the images are in capture order.
        places: (F, 3) metres, NaN where unknown, or None.
    """
    pairs = _best(-likeness, MAX_SIMILAR)
    if in_order:
        pairs |= {(i, i + step) for step in FOLLOWING for i in range(len(likeness) - step)}
    if places is not None:
        distances = np.linalg.norm(places[:, None] - places[None], axis=2)
        np.fill_diagonal(distances, np.inf)
        pairs |= _best(np.where(np.isfinite(distances), distances, np.inf), MAX_NEARBY)
    return pairs


def are_in_order(names: Sequence[str]) -> bool:
    """Whether names are numbered consecutively, as cameras do: most numbers follow closely on the previous one."""
    numbers = [int(found[-1]) for found in (re.findall(r"\d+", name) for name in names) if found]
    if len(numbers) < len(names) or len(names) < 2:
        return False
    steps = np.diff(np.array([float(number) for number in numbers]))
    # Names with seconds have large steps; what counts is that steps are positive and mostly similar.
    return bool(np.all(steps > 0) and np.median(steps) * 10 >= np.quantile(steps, 0.8))


def _best(costs: np.ndarray, most: int) -> Pairs:
    """For each image, the others of lowest finite cost."""
    nearest = np.argsort(costs, axis=1, kind="stable")[:, :most]
    rows = np.repeat(np.arange(len(costs)), nearest.shape[1])
    chosen = zip(rows.tolist(), nearest.reshape(-1).tolist(), strict=True)
    return {(min(i, j), max(i, j)) for i, j in chosen if i != j and np.isfinite(costs[i, j])}
