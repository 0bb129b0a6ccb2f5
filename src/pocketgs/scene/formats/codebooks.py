"""Codebooks: few numbers or vectors that approximate many."""

from __future__ import annotations

import numpy as np

ROUNDS = 4
PER_ENTRY = 16
"""Number of vectors per entry that a codebook is fitted to. With 8, a `.pgs` loses 0.37 dB by its harmonics on fern and
0.80 on fox; with 16, 0.31 and 0.71."""

BLOCK = 1 << 22
"""Maximum number of distances in memory."""

EVEN = 0.85
"""Share of a scalar codebook's entries that are spread evenly; the others are spread as frequently as values occur."""

NARROWINGS = 32
"""Number of times that the step between entries is narrowed. A step that is still too wide wastes only entries."""


def scalar_codebook(values: np.ndarray, entries: int) -> tuple[np.ndarray, np.ndarray]:
    """Up to `entries` numbers that approximate all values.

    Returns:
        (entries,) ascending float64 numbers, the last repeated if fewer are needed, and each value's index.
    """
    flat = np.sort(values.astype(np.float64), axis=None)
    distinct = np.unique(flat)
    if len(distinct) <= entries:
        book = np.concatenate([distinct, np.full(entries - len(distinct), distinct[-1])])
        return book, np.searchsorted(distinct, values.astype(np.float64))
    # Nearer to equally wide than to equally frequent ranges: outliers are rare but seen. Rounding fox's log scales, of
    # which the far background has few, costs 0.01 dB so; after 32 rounds of Lloyd's algorithm it cost 0.17.
    cells = np.rint(_places(flat, entries) * (entries - 1)).astype(np.int64)
    sizes = np.bincount(cells, minlength=entries)
    means = np.bincount(cells, flat, entries) / np.maximum(sizes, 1)
    book = np.maximum.accumulate(np.where(sizes > 0, means, -np.inf))
    return book, np.searchsorted(0.5 * (book[1:] + book[:-1]), values.astype(np.float64))


def _places(ascending: np.ndarray, entries: int) -> np.ndarray:
    """(N,) places from 0 to 1 of ascending values; those nearest to the same 1 / (entries - 1) share an entry.

    A place mostly says how far a value is from the first one. A gap counts as one step between entries at most, so
    that an outlier takes an entry of its own and leaves the others to the rest.
    """
    gaps = np.diff(ascending)
    even = EVEN * (entries - 1)
    step = (ascending[-1] - ascending[0]) / even
    for _ in range(NARROWINGS):
        step = np.minimum(gaps, step).sum() / even
    distances = np.concatenate([[0.0], np.cumsum(np.minimum(gaps, step))])
    return EVEN * distances / distances[-1] + (1.0 - EVEN) * np.linspace(0.0, 1.0, len(ascending))


def vector_codebook(vectors: np.ndarray, entries: int, weights: np.ndarray, seed: int = 0) -> np.ndarray:
    """Vectors that approximate all vectors, by weighted squared distance and Lloyd's algorithm.

    Args:
        vectors: (N, D).
        entries: maximum number of vectors to return.
        weights: (N,) positive.
        seed: of the random choice of first entries.

    Returns:
        (E, D) float32.
    """
    vectors = np.ascontiguousarray(vectors, np.float32)
    # Equal vectors have equal bytes, which are faster to compare.
    _, first = np.unique(vectors.view(f"V{vectors.strides[0]}"), return_index=True)
    if len(first) <= entries:
        return vectors[first]
    rng = np.random.default_rng(seed)
    chosen = rng.permutation(len(vectors))[: PER_ENTRY * entries]
    vectors, weights = vectors[chosen], weights[chosen].astype(np.float64)
    first = rng.choice(len(vectors), entries, replace=False, p=weights / weights.sum())
    book = vectors[first]
    for _ in range(ROUNDS):
        labels = nearest(vectors, book)
        mass = np.bincount(labels, weights, entries)
        sums = [np.bincount(labels, weights * column, entries) for column in vectors.T]
        means = np.stack(sums, axis=1) / np.maximum(mass, 1e-30)[:, None]
        book = np.where(mass[:, None] > 0, means, book).astype(np.float32)
    return book[np.bincount(nearest(vectors, book), minlength=entries) > 0]


def nearest(vectors: np.ndarray, book: np.ndarray) -> np.ndarray:
    """(N,) index of the nearest entry of each vector."""
    book = book.astype(np.float32)
    # One more column, so that a single product gives v.b - b.b / 2, which is largest where |v - b| is smallest.
    columns = np.concatenate([book, -0.5 * np.einsum("ij,ij->i", book, book)[:, None]], axis=1).T.copy()
    vectors = np.concatenate([vectors.astype(np.float32), np.ones((len(vectors), 1), np.float32)], axis=1)
    labels = np.empty(len(vectors), np.int64)
    size = max(1, BLOCK // len(book))
    for start in range(0, len(vectors), size):
        labels[start : start + size] = (vectors[start : start + size] @ columns).argmax(axis=1)
    return labels
