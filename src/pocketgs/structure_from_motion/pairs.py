"""Choosing image pairs to match: all pairs of a few images; else those that are similar, near, or consecutive."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from itertools import combinations, pairwise
from pathlib import PurePath
from statistics import median

import numpy as np

from pocketgs.capture.unposed import by_number

MAX_FOR_ALL_PAIRS = 45
"""Maximum number of images to match exhaustively: 45 images have 990 pairs."""

MAX_SIMILAR = 20
FOLLOWING = (1, 2, 3, 4, 6, 8)
MAX_NEARBY = 8
MAX_GAP = 100
"""Maximum gap in a sequence's numbers, in usual steps: the largest of a photograph each second is at a full minute."""

Pairs = set[tuple[int, int]]
"""Pairs of image indices, the smaller first."""


def all_pairs(count: int) -> Pairs:
    """All pairs of `count` images."""
    return set(combinations(range(count), 2))


def chosen_pairs(likeness: np.ndarray, in_order: Iterable[Sequence[int]], places: np.ndarray | None = None) -> Pairs:
    """Pairs that probably overlap.

    Args:
        likeness: (F, F), see `retrieval`.
        in_order: sequences of images in capture order.
        places: (F, 3) metres, NaN where unknown, or None.
    """
    pairs = _best(-likeness, MAX_SIMILAR)
    for sequence in in_order:
        following = (pair for step in FOLLOWING for pair in zip(sequence, sequence[step:], strict=False))
        pairs |= {(min(i, j), max(i, j)) for i, j in following}
    if places is not None:
        distances = np.linalg.norm(places[:, None] - places[None], axis=2)
        np.fill_diagonal(distances, np.inf)
        pairs |= _best(np.where(np.isfinite(distances), distances, np.inf), MAX_NEARBY)
    return pairs


def likeliest_pairs(likeness: np.ndarray, among: Iterable[int], without: Pairs, most: int) -> Pairs:
    """The likeliest pairs of the images in `among` with any others, each image getting its share.

    Images take turns, because the pairs of one that is like many would leave none to the others.

    Args:
        likeness: (F, F), see `retrieval`.
        among: images to pair.
        without: pairs to leave out.
        most: maximum number of pairs.
    """
    turns: dict[tuple[int, int], int] = {}
    for image in among:
        others = [other for other in np.argsort(-likeness[image], kind="stable").tolist() if other != image]
        pairs = [(min(image, other), max(image, other)) for other in others]
        for turn, pair in enumerate(pair for pair in pairs if pair not in without):
            turns[pair] = min(turn, turns.get(pair, turn))
    return set(sorted(turns, key=lambda pair: (turns[pair], -likeness[pair], pair))[:most])


def sequences(names: Sequence[str]) -> list[list[int]]:
    """Images in capture order by the numbers in their names, as cameras count.

    A new sequence begins where the counter does, where the rest of the name changes, and after a gap that is large for
    these names: numbers that are times have gaps of different sizes.
    """
    order = sorted(range(len(names)), key=lambda index: by_number(names[index]))
    steps = [_step(names[first], names[second]) for first, second in pairwise(order)]
    largest = MAX_GAP * median([step for step in steps if step > 0] or [0])
    found = [order[:1]]
    for index, step in zip(order[1:], steps, strict=True):
        if 0 < step <= largest:
            found[-1].append(index)
        else:
            found.append([index])
    return found


def _step(first: str, second: str) -> int:
    """By how much the last number in a name grows; 0 if the rest of the names differs."""
    (text, number), (next_text, next_number) = map(_text_and_number, (first, second))
    return next_number - number if text == next_text else 0


def _text_and_number(name: str) -> tuple[str, int]:
    """A name without its numbers, some of which may be times, and the last of them."""
    stem = PurePath(name).stem
    numbers = re.findall(r"\d+", stem)
    return re.sub(r"\d+", "", stem), int(numbers[-1]) if numbers else 0


def _best(costs: np.ndarray, most: int) -> Pairs:
    """For each image, the others of lowest finite cost."""
    nearest = np.argsort(costs, axis=1, kind="stable")[:, :most]
    rows = np.repeat(np.arange(len(costs)), nearest.shape[1])
    chosen = zip(rows.tolist(), nearest.reshape(-1).tolist(), strict=True)
    return {(min(i, j), max(i, j)) for i, j in chosen if i != j and np.isfinite(costs[i, j])}
