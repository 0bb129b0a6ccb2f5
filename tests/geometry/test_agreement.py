"""Groups of views, from numbers of matches."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from pocketgs.geometry.agreement import agreeing_groups


def symmetric(pairs: dict[tuple[int, int], int], views: int) -> np.ndarray:
    """(F, F) number of matches of each pair."""
    found = np.zeros((views, views))
    for (first, second), count in pairs.items():
        found[first, second] = found[second, first] = count
    return found


def test_views_without_matches_are_alone() -> None:
    nothing = np.zeros((3, 3))
    np.testing.assert_array_equal(agreeing_groups(nothing, nothing), [0, 1, 2])


def test_a_minority_of_supporting_matches_joins_nothing() -> None:
    """Two pairs of views, which 30 of 100 matches would join."""
    inside, across = {(0, 1): 100, (2, 3): 90}, {(0, 2): 30, (1, 3): 70}
    total = symmetric(inside | across, 4)
    found = agreeing_groups(total, symmetric(inside | {(0, 2): 30}, 4))
    assert found[0] == found[1] != found[2] == found[3]
    found = agreeing_groups(total, symmetric(inside | {(1, 3): 70}, 4))
    assert len(set(found.tolist())) == 1


@given(st.integers(2, 8), st.randoms(use_true_random=False))
def test_if_all_matches_support_all_that_match_are_one_group(views: int, random: object) -> None:
    """As the connected parts of the graph of matches."""
    draw = np.random.default_rng(random.getrandbits(32))  # type: ignore[attr-defined]
    total = np.triu(draw.integers(0, 3, (views, views)), 1).astype(float)
    total += total.T
    reach = np.linalg.matrix_power((total > 0) + np.eye(views), views) > 0
    group = agreeing_groups(total, total)
    np.testing.assert_array_equal(group[:, None] == group, reach)
