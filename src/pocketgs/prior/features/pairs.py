"""Pairs of views to match: near by pose, consecutive, or similar in appearance.

The pose of a misplaced camera names the wrong neighbours. The other two criteria still find the right ones.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pocketgs.capture.unposed import by_number
from pocketgs.geometry.camera import Camera
from pocketgs.prior.features.features import DESCRIPTOR, Features
from pocketgs.prior.features.tracks import WIDEST_AXES_ANGLE, view_distances

Pair = tuple[int, int]
"""Indices of two views, the smaller first."""

RANKS_BY_POSE = (0, 1, 2, 4, 7, 11, 16)
"""Ranks among the neighbours by pose: the nearest, and some farther ones for longer baselines."""

STEPS_IN_SEQUENCE = (1, 2)
MAX_SIMILAR = 4
"""Number of most similar views to match with."""

PAIRS_PER_VIEW = len(RANKS_BY_POSE) + len(STEPS_IN_SEQUENCE) + MAX_SIMILAR
"""Maximum number of pairs per view."""

WORDS = 1024
"""Size of the vocabulary for comparing images."""


def choose_pairs(
    names: Sequence[str], cameras: Sequence[Camera], features: Sequence[Features], scene_distance: float
) -> list[Pair]:
    """Choose the pairs of views to match, sorted and unique.

    Args:
        names: of F frames; in sorted order they are in capture order.
        cameras: with given poses.
        features: of the frames.
        scene_distance: typical distance to the scene.
    """
    chosen = set(by_pose(cameras, scene_distance)) | set(in_sequence(names)) | set(by_appearance(features))
    return sorted(chosen)


def by_pose(cameras: Sequence[Camera], scene_distance: float) -> list[Pair]:
    """Pairs of views that overlap according to their poses."""
    forwards = np.array([camera.forward for camera in cameras])
    apart = view_distances(cameras, cameras, scene_distance)
    apart[forwards @ forwards.T < np.cos(WIDEST_AXES_ANGLE)] = np.inf
    np.fill_diagonal(apart, np.inf)
    pairs = set()
    for view, distances in enumerate(apart):
        order = np.argsort(distances, kind="stable")
        for other in order[[rank for rank in RANKS_BY_POSE if rank < len(order)]]:
            if np.isfinite(distances[other]):
                pairs.add(_pair(view, int(other)))
    return sorted(pairs)


def in_sequence(names: Sequence[str]) -> list[Pair]:
    """Pairs of consecutive frames, by name; numbers in names are compared as numbers."""
    order = sorted(range(len(names)), key=lambda index: by_number(names[index]))
    return sorted(
        _pair(first, second) for step in STEPS_IN_SEQUENCE for first, second in zip(order, order[step:], strict=False)
    )


def by_appearance(features: Sequence[Features]) -> list[Pair]:
    """Pairs of views with similar features; rare features count more (Sivic and Zisserman 2003)."""
    rows = likeness(features)
    np.fill_diagonal(rows, -1.0)
    pairs = set()
    for view, row in enumerate(rows):
        for other in np.argsort(-row, kind="stable")[:MAX_SIMILAR]:
            if row[other] > 0:
                pairs.add(_pair(view, int(other)))
    return sorted(pairs)


def likeness(features: Sequence[Features]) -> np.ndarray:
    """(F, F) cosine similarity of the views' tf-idf-weighted word histograms.

    Words are random features: clustering would be slower, and hardly better for this number of views.
    """
    words = _words(features)
    counts = np.zeros((len(features), max(len(words), 1)))
    for row, view in zip(counts, features, strict=True):
        if len(view.descriptors):
            np.add.at(row, (view.descriptors @ words.T).argmax(axis=1), 1)
    rarity = np.log((1 + len(features)) / (1 + np.count_nonzero(counts, axis=0)))
    weighted = np.sqrt(counts) * rarity
    weighted /= np.maximum(np.linalg.norm(weighted, axis=1, keepdims=True), 1e-12)
    return weighted @ weighted.T


def _words(features: Sequence[Features]) -> np.ndarray:
    """(W, 128) descriptors of random features, at most `WORDS`, without a copy of all of them."""
    starts = np.cumsum([0, *(len(view.descriptors) for view in features)])
    drawn = np.sort(np.random.default_rng(0).permutation(starts[-1])[:WORDS])
    views = np.searchsorted(starts, drawn, side="right") - 1
    words = [features[view].descriptors[number] for view, number in zip(views, drawn - starts[views], strict=True)]
    return np.array(words, np.float32).reshape(-1, DESCRIPTOR)


def _pair(first: int, second: int) -> Pair:
    return min(first, second), max(first, second)
