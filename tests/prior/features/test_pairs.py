"""Pairs of views to match: by pose, by sequence and by appearance."""

from __future__ import annotations

import tracemalloc

import numpy as np

from pocketgs.geometry.camera import Camera, look_at
from pocketgs.prior.features.features import Features
from pocketgs.prior.features.pairs import (
    PAIRS_PER_VIEW,
    WORDS,
    _words,
    by_appearance,
    by_pose,
    choose_pairs,
    in_sequence,
)


def camera_at(eye: tuple[float, float, float]) -> Camera:
    """A camera that looks at the origin."""
    return Camera(640, 480, 500.0, 520.0, 318.0, 243.0, look_at(np.array(eye), np.zeros(3), np.array([0.0, 0, 1])))


def ring(count: int) -> list[Camera]:
    angles = np.arange(count) * 2 * np.pi / count
    return [camera_at((4 * np.sin(angle), 4 * np.cos(angle), 0)) for angle in angles]


def features_of(kinds: np.ndarray, seed: int) -> Features:
    """Features that are slightly different each time, of the given kinds."""
    kind = np.abs(np.random.default_rng(1).normal(size=(1000, 128)))[kinds]
    descriptors = kind + 0.05 * np.abs(np.random.default_rng(seed).normal(size=kind.shape))
    descriptors /= np.linalg.norm(descriptors, axis=1, keepdims=True)
    return Features(np.zeros((len(kinds), 2)), descriptors.astype(np.float32))


def test_poses_pair_neighbours_that_look_the_same_way() -> None:
    pairs = by_pose(ring(60), 4.0)
    assert pairs == sorted(set(pairs))
    apart = [min(second - first, 60 - second + first) for first, second in pairs]
    assert min(apart) == 1
    assert max(apart) <= 10
    assert all((index, index + 1) in pairs for index in range(59))


def test_poses_that_look_apart_make_no_pair() -> None:
    eyes = [(4.0, 0.0, 0.0), (-4.0, 0.0, 0.0), (0.0, 4.0, 0.0), (0.0, -4.0, 0.0)]
    assert by_pose([camera_at(eye) for eye in eyes], 4.0) == []
    assert by_pose([camera_at(eyes[0])], 4.0) == []


def test_numbers_in_names_count_as_numbers() -> None:
    assert in_sequence(["f10.png", "f9.png", "f8.png", "f100.png"]) == [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3)]
    assert in_sequence(["alone.png"]) == []


def test_views_that_show_the_same_kinds_are_alike() -> None:
    kinds = np.random.default_rng(0).permutation(1000).reshape(5, 200)
    features = [features_of(kinds[view // 2], view) for view in range(10)]
    pairs = by_appearance(features)
    assert all((view, view + 1) in pairs for view in range(0, 10, 2))


def test_words_are_drawn_without_a_copy_of_all_features() -> None:
    features = [features_of(np.random.default_rng(view).integers(0, 1000, 200 + view % 3), view) for view in range(60)]
    everything = np.concatenate([view.descriptors for view in features])
    drawn = np.sort(np.random.default_rng(0).permutation(len(everything))[:WORDS])
    np.testing.assert_array_equal(_words([*features, Features.none()]), everything[drawn])
    tracemalloc.start()
    try:
        _words(features)
        assert tracemalloc.get_traced_memory()[1] < everything.nbytes / 2
    finally:
        tracemalloc.stop()


def test_views_without_features_are_like_nothing() -> None:
    nothing = Features(np.zeros((0, 2)), np.zeros((0, 128), np.float32))
    assert by_appearance([nothing] * 3) == []
    assert by_appearance([]) == []


def test_no_view_is_matched_too_often() -> None:
    rng = np.random.default_rng(0)
    features = [features_of(rng.integers(0, 1000, 100), view) for view in range(60)]
    pairs = choose_pairs([f"{view}.png" for view in range(60)], ring(60), features, 4.0)
    assert pairs == sorted(set(pairs))
    assert all(first < second for first, second in pairs)
    assert len(pairs) <= 60 * PAIRS_PER_VIEW
