"""Image retrieval: a vector per image from its features, with a vocabulary built from the images themselves.

The vector is a VLAD (Jégou et al. 2010, "Aggregating local descriptors into a compact image representation"),
normalised per word (Arandjelović and Zisserman 2013, "All about VLAD").
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

WORDS = 128
FEATURES_OF_AN_IMAGE = 1500
SAMPLE = 30_000
"""Number of descriptors that the vocabulary is built from."""

ROUNDS = 8
"""Iterations of k-means. The vocabulary need not be exact."""


def similarities(descriptors: Sequence[np.ndarray], seed: int = 0) -> np.ndarray:
    """Similarity of all pairs of images.

    Args:
        descriptors: of each image (N, 128) uint8, the strongest features first.
        seed: of the vocabulary.

    Returns:
        (F, F) float32, from -1 to 1; -1 on the diagonal.
    """
    used = [rows[:FEATURES_OF_AN_IMAGE].astype(np.float32) / 512 for rows in descriptors]
    words = _vocabulary(np.concatenate(used), seed)
    signatures = np.stack([_signature(rows, words) for rows in used])
    found = signatures @ signatures.T
    np.fill_diagonal(found, -1.0)
    return found


def _vocabulary(descriptors: np.ndarray, seed: int) -> np.ndarray:
    """(W, 128) words: k-means on a sample. Fewer words if there are few descriptors."""
    generator = np.random.default_rng(seed)
    chosen = generator.permutation(len(descriptors))[:SAMPLE]
    sample = descriptors[chosen]
    words = sample[:WORDS].copy()
    for _ in range(ROUNDS if len(words) else 0):
        nearest = _nearest(sample, words)
        counts = np.bincount(nearest, minlength=len(words))
        sums = np.zeros_like(words)
        np.add.at(sums, nearest, sample)
        words = np.where(counts[:, None] > 0, sums / np.maximum(counts, 1)[:, None], words).astype(np.float32)
    return words


def _signature(descriptors: np.ndarray, words: np.ndarray) -> np.ndarray:
    """(W * 128,) VLAD of length 1: for each word the sum of its descriptors' residuals."""
    sums = np.zeros_like(words)
    if len(descriptors):
        nearest = _nearest(descriptors, words)
        np.add.at(sums, nearest, descriptors - words[nearest])
    sums /= np.maximum(np.linalg.norm(sums, axis=1, keepdims=True), 1e-12)
    return sums.reshape(-1) / max(float(np.linalg.norm(sums)), 1e-12)


def _nearest(descriptors: np.ndarray, words: np.ndarray) -> np.ndarray:
    """(N,) index of the nearest word of each descriptor."""
    return np.argmax(descriptors @ words.T - (words**2).sum(axis=1) / 2, axis=1)
