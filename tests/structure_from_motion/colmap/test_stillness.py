"""When a capture's camera counts as standing still."""

from __future__ import annotations

import numpy as np
import pytest

from pocketgs.structure_from_motion.colmap.stillness import STILL, stands_still


@pytest.mark.parametrize(
    ("moved_pairs", "expected"),
    [(0, True), (1, True), (2, False), (10, False)],
)
def test_a_few_pairs_may_show_what_moved(moved_pairs: int, expected: bool) -> None:
    still, moved = np.tile([0.9 * STILL, 0.0], (20, 1)), np.tile([0.0, 1.1 * STILL], (20, 1))
    assert stands_still([moved] * moved_pairs + [still] * (10 - moved_pairs)) == expected


def test_most_matches_decide() -> None:
    shifts = np.zeros((10, 2))
    shifts[:4] = 0.5
    assert stands_still([shifts])
    shifts[:6] = 0.5
    assert not stands_still([shifts])


def test_without_matching_pairs() -> None:
    assert not stands_still([])


@pytest.mark.parametrize(("shift", "expected"), [(0.005, True), (0.015, False)])
def test_small_steps_are_steps(shift: float, expected: bool) -> None:
    """By 1.5 % of the diagonal, 75 pixels of a phone's 5000, things shift for someone who walks slowly."""
    assert stands_still([np.tile([shift, 0.0], (20, 1))] * 10) == expected
