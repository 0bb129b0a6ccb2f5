"""Which photographs are matched with which."""

from __future__ import annotations

import numpy as np
import pytest

from pocketgs.structure_from_motion.pairs import MAX_SIMILAR, all_pairs, are_in_order, chosen_pairs
from pocketgs.structure_from_motion.retrieval import similarities


def test_few_photographs_are_all_matched() -> None:
    assert all_pairs(3) == {(0, 1), (0, 2), (1, 2)}
    assert all_pairs(4, [2]) == {(0, 2), (1, 2), (2, 3)}


def test_many_photographs_are_matched_with_those_like_them() -> None:
    count = 200
    places = np.linspace(0, 2 * np.pi, count, endpoint=False)
    likeness = np.cos(places[:, None] - places[None])
    np.fill_diagonal(likeness, -1)
    pairs = chosen_pairs(likeness, in_order=False)
    assert all(first < second for first, second in pairs)
    assert (0, count - 1) in pairs  # the loop closes
    assert count * MAX_SIMILAR / 2 <= len(pairs) <= count * MAX_SIMILAR
    with_neighbours = chosen_pairs(np.zeros((count, count)), in_order=True)
    assert {(i, i + 1) for i in range(count - 1)} <= with_neighbours


def test_neighbours_by_gps_are_matched_and_unknown_places_are_not() -> None:
    places = np.stack([np.arange(60.0), np.zeros(60), np.zeros(60)], axis=1)
    places[7] = np.nan
    likeness = np.zeros((60, 60))
    pairs = chosen_pairs(likeness, in_order=False, places=places)
    without = chosen_pairs(likeness, in_order=False)
    assert {(30, 31), (30, 32), (40, 41)} <= pairs
    assert not any(7 in pair for pair in pairs - without)


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        (["IMG_0012.jpg", "IMG_0013.jpg", "IMG_0015.jpg"], True),
        (["20240212_003919.jpg", "20240212_003920.jpg", "20240212_003925.jpg"], True),
        (["a.jpg", "b.jpg", "c.jpg"], False),
        (["1.jpg", "3.jpg", "2.jpg"], False),
        (["12345678.jpg"], False),
    ],
)
def test_names_that_count_up(names: list[str], expected: bool) -> None:
    assert are_in_order(names) is expected


def test_images_with_common_features_are_alike() -> None:
    generator = np.random.default_rng(0)
    scenes = [generator.integers(0, 120, (400, 128), dtype=np.uint8) for _ in range(2)]
    images = [scenes[number % 2][generator.permutation(400)[:300]] for number in range(8)]
    images.append(np.zeros((0, 128), np.uint8))
    found = similarities(images)
    assert found.shape == (9, 9)
    for number in range(8):
        alike = found[number, [other for other in range(8) if other != number and (other - number) % 2 == 0]]
        others = found[number, [other for other in range(8) if (other - number) % 2]]
        assert alike.min() > others.max()
    assert np.array_equal(found, similarities(images))
