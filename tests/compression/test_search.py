"""The search for a number of Gaussians."""

from __future__ import annotations

import math

from hypothesis import given
from hypothesis import strategies as st

from pocketgs.compression.search import CLOSE, TRIES, Goal, search

COUNTS = st.integers(32, 1_000_000)


@given(least=COUNTS, guess=COUNTS, slope=st.floats(0.4, 2.5), offset=st.floats(-1.5, 1.5), from_above=st.booleans())
def test_values_that_grow_with_the_logarithm(
    least: int, guess: int, slope: float, offset: float, from_above: bool
) -> None:
    """The search is precise even if the expected slope is not."""
    most, tried = 64 * least, []
    wanted = math.log(8 * least) + offset
    goal = Goal(target=slope * wanted, slope=1.0, tolerance=0.02, from_above=from_above)

    def value_of(count: int) -> float:
        tried.append(count)
        return slope * math.log(count)

    search(value_of, goal, guess, least, most)
    assert len(tried) <= TRIES
    assert all(least <= count <= most for count in tried)
    near = [count for count in tried if goal.met_by(slope * math.log(count))]
    assert near
    assert min(abs(math.log(count) - wanted) for count in near) <= 3 * CLOSE + 0.02 / slope


def test_a_bound_that_no_number_meets() -> None:
    tried: list[int] = []
    search(lambda count: tried.append(count) or 20.0, Goal(30.0, 0.8, 0.04, True), 500, 32, 1000)  # type: ignore[func-returns-value]
    assert tried[-1] == 1000


def test_a_size_that_everything_fits() -> None:
    tried: list[int] = []
    search(lambda count: tried.append(count) or 1.0, Goal(3.0, 1.0, 0.04, False), 5000, 32, 1000)  # type: ignore[func-returns-value]
    assert tried == [1000]
