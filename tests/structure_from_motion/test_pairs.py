"""Pairs of photographs to match."""

from __future__ import annotations

import numpy as np
import pytest

from pocketgs.structure_from_motion.pairs import MAX_SIMILAR, all_pairs, chosen_pairs, likeliest_pairs, sequences
from pocketgs.structure_from_motion.retrieval import similarities


def test_few_photographs_are_all_matched() -> None:
    assert all_pairs(3) == {(0, 1), (0, 2), (1, 2)}
    assert likeliest_pairs(np.zeros((4, 4)), [2], set(), 10) == {(0, 2), (1, 2), (2, 3)}


def test_many_photographs_are_matched_with_those_like_them() -> None:
    count = 200
    places = np.linspace(0, 2 * np.pi, count, endpoint=False)
    likeness = np.cos(places[:, None] - places[None])
    np.fill_diagonal(likeness, -1)
    pairs = chosen_pairs(likeness, [])
    assert all(first < second for first, second in pairs)
    assert (0, count - 1) in pairs  # the loop closes
    assert count * MAX_SIMILAR / 2 <= len(pairs) <= count * MAX_SIMILAR
    with_neighbours = chosen_pairs(np.zeros((count, count)), [range(count)])
    assert {(i, i + 1) for i in range(count - 1)} <= with_neighbours


def test_neighbours_by_gps_are_matched_and_unknown_places_are_not() -> None:
    places = np.stack([np.arange(60.0), np.zeros(60), np.zeros(60)], axis=1)
    places[7] = np.nan
    likeness = np.zeros((60, 60))
    pairs = chosen_pairs(likeness, [], places=places)
    without = chosen_pairs(likeness, [])
    assert {(30, 31), (30, 32), (40, 41)} <= pairs
    assert not any(7 in pair for pair in pairs - without)


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        (["IMG_0012.jpg", "IMG_0013.jpg", "IMG_0015.jpg"], [[0, 1, 2]]),
        (["20240212_003919.jpg", "20240212_003920.jpg", "20240212_003925.jpg"], [[0, 1, 2]]),
        (["DJI_20240212003919_0001.jpg", "DJI_20240212004101_0002.jpg"], [[0, 1]]),
        (["1.jpg", "10.jpg", "2.png"], [[0, 2, 1]]),
        (["a.jpg", "b.jpg", "c.jpg"], [[0], [1], [2]]),
        (["cover.jpg", "x_1.jpg", "x_2.jpg"], [[0], [1, 2]]),
        # The counter began anew, and photographs of two phones.
        (["IMG_0001.jpg", "IMG_0002.jpg", "IMG_9998.jpg", "IMG_9999.jpg"], [[0, 1], [2, 3]]),
        (["100_IMG_9998.jpg", "100_IMG_9999.jpg", "101_IMG_0001.jpg", "101_IMG_0002.jpg"], [[0, 1], [2, 3]]),
        (["IMG_7.jpg", "IMG_8.jpg", "PXL_8.jpg", "PXL_9.jpg"], [[0, 1], [2, 3]]),
    ],
)
def test_sequences_by_the_numbers_in_names(names: list[str], expected: list[list[int]]) -> None:
    assert sequences(names) == expected


def test_no_consecutive_pair_across_a_break() -> None:
    nothing_alike = np.full((60, 60), -np.inf)
    pairs = chosen_pairs(nothing_alike, [range(30), range(59, 29, -1)])
    assert {(28, 29), (30, 31), (51, 59)} <= pairs
    assert not any(first < 30 <= second for first, second in pairs)


def test_extra_pairs_are_the_likeliest_and_each_image_gets_its_share() -> None:
    likeness = np.random.default_rng(0).random((60, 60))
    likeness = likeness + likeness.T
    likeness[5] += 1  # so alike to others that its pairs alone would be the likeliest
    likeness[:, 5] += 1
    done = {(5, 9), (7, 20)}
    chosen = likeliest_pairs(likeness, [5, 7, 40], done, 30)
    assert len(chosen) == 30
    assert not chosen & done
    assert not any(first == second for first, second in chosen)
    for image in (5, 7, 40):
        assert sum(image in pair for pair in chosen) >= 10
    others = [other for other in range(60) if other not in (5, 7, 40, 20)]
    assert tuple(sorted((7, max(others, key=lambda other: likeness[7, other])))) in chosen
    assert likeliest_pairs(likeness, [5, 7], done, 5000) == {pair for pair in all_pairs(60) if {5, 7} & {*pair}} - done


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
