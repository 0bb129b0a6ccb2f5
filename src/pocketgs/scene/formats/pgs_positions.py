"""Encoding of a `.pgs`'s positions: a tree that halves space, and how many Gaussians lie in each half.

Cells are (N, 3) non-negative integers. Each level halves all nodes along x, then y, then z, and states how many of a
node's Gaussians lie in the lower half. A lone Gaussian states at each level whether the rest of its bits is zero: large
ones need fewer. Since the order of Gaussians is that of the tree (Morton order), it costs nothing.
"""

from __future__ import annotations

import numpy as np

from pocketgs.scene.formats.range_coder import RangeDecoder, RangeEncoder, new_models
from pocketgs.system.compile import kernel

EXACT = 24
"""Counts up to this have models of their own."""

COUNTS = EXACT + 33
MAX_BITS = 24


def morton_sorted(cells: np.ndarray) -> np.ndarray:
    """(N,) indices that put cells into the order of the tree."""
    words = []
    for first in range(0, MAX_BITS, MAX_BITS // 2):
        word = np.zeros(len(cells), np.int64)
        for bit in range(MAX_BITS // 2):
            for axis in range(3):
                word |= (cells[:, axis] >> (first + bit) & 1) << (3 * bit + 2 - axis)
        words.append(word)
    # The last key counts most.
    return np.lexsort(words)


def encode_positions(cells: np.ndarray, bits: int) -> bytes:
    """Encode cells in Morton order, all below 2^bits."""
    coder = RangeEncoder()
    splits, stops = new_models(3 * COUNTS), new_models(bits + 1)
    starts, counts = np.array([0]), np.array([len(cells)])
    is_open = np.array([True])
    previous = np.zeros(1, np.int64)
    for bit in range(bits - 1, -1, -1):
        lone = is_open & (counts == 1)
        ends = (cells[starts[lone]] & ((2 << bit) - 1) == 0).all(axis=1)
        coder.column(ends, np.full(len(ends), bit), stops)
        is_open[lone] = ~ends
        for axis in range(3):
            upper = np.concatenate([[0], np.cumsum(cells[:, axis] >> bit & 1)])
            lower = counts - (upper[starts + counts] - upper[starts])
            coder.column(lower[is_open], _contexts(counts[is_open], previous[is_open]), splits)
            lower[~is_open] = counts[~is_open]
            parents, side, counts_now, is_open, previous = _halved(counts, lower, is_open)
            starts, counts = starts[parents] + side * lower[parents], counts_now
    return coder.finish()


def decode_positions(stream: bytes, count: int, bits: int) -> np.ndarray:
    """(N, 3) cells in Morton order."""
    coder = RangeDecoder(stream)
    splits, stops = new_models(3 * COUNTS), new_models(bits + 1)
    cells, counts = np.zeros((1, 3), np.int64), np.array([count])
    is_open = np.array([True])
    previous = np.zeros(1, np.int64)
    for bit in range(bits - 1, -1, -1):
        lone = is_open & (counts == 1)
        is_open[lone] = coder.column(np.full(np.count_nonzero(lone), bit), stops) == 0
        for axis in range(3):
            lower = counts.copy()
            found = coder.column(_contexts(counts[is_open], previous[is_open]), splits)
            lower[is_open] = np.clip(found, 0, counts[is_open])
            parents, side, counts, is_open, previous = _halved(counts, lower, is_open)
            cells = cells[parents]
            cells[:, axis] |= side << bit
    return np.repeat(cells, counts, axis=0)


def _contexts(counts: np.ndarray, previous: np.ndarray) -> np.ndarray:
    large = EXACT + np.frexp(counts.astype(np.float64))[1]
    return np.where(counts <= EXACT, counts, large) + COUNTS * previous


@kernel
def _halved(
    counts: np.ndarray, lower: np.ndarray, is_open: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The non-empty halves of all nodes, in order.

    Returns:
        (M,) node that each is a half of, whether it is the upper one, count, whether it is still divided, and whether
        both halves, the lower or the upper one of its node are non-empty.
    """
    size = np.count_nonzero(lower) + np.count_nonzero(lower < counts)
    parents, side, left = np.empty(size, np.int64), np.empty(size, np.int64), np.empty(size, np.int64)
    still, outcome = np.empty(size, np.bool_), np.empty(size, np.int64)
    place = 0
    for node in range(len(counts)):
        both = lower[node], counts[node] - lower[node]
        for half in range(2):
            if both[half]:
                parents[place], side[place], left[place] = node, half, both[half]
                still[place] = is_open[node]
                outcome[place] = 0 if both[1 - half] else 1 + half
                place += 1
    return parents, side, left, still, outcome
