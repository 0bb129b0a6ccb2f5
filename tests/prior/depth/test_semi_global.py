"""Semi-global matching: sums along paths against a plain twin, and winners whose place is known."""

from __future__ import annotations

from collections.abc import Iterator

import numba
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pocketgs.prior.depth.cpu.semi_global import EIGHT_PATHS, FOUR_PATHS, aggregate, winners
from pocketgs.prior.depth.sweep_constants import EDGE, NOISE, RIVAL_DISTANCE

SHAPES = [(1, 1, 8), (1, 7, 8), (6, 1, 9), (5, 9, 11), (13, 8, 16), (70, 3, 8)]


def volume(*shape: int, seed: int = 0, most: int = 49) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, most, shape, dtype=np.uint8)


def twin(costs: np.ndarray, view: np.ndarray, paths: np.ndarray, small_step: int, large_step: int) -> np.ndarray:
    """Equation 13 of Hirschmüller 2008, pixel by pixel, each path from where it enters the image."""
    height, width, hypotheses = costs.shape
    total = np.zeros(costs.shape, int)
    for down, across in paths:
        reached: dict[tuple[int, int], np.ndarray] = {}
        for row in range(height)[:: 1 if down >= 0 else -1]:
            for column in range(width)[:: 1 if across >= 0 else -1]:
                before = (row - down, column - across)
                reached[row, column] = costs[row, column].astype(int)
                if before in reached:
                    edge = abs(int(view[row, column]) - int(view[before]))
                    jump = max(small_step, large_step * EDGE // (EDGE + edge))
                    earlier = np.pad(reached[before], 1, constant_values=10**6)
                    ways = [earlier[1:-1], earlier[:-2] + small_step, earlier[2:] + small_step]
                    ways.append(np.full(hypotheses, earlier.min() + jump))
                    reached[row, column] += np.min(ways, axis=0) - earlier.min()
                total[row, column] += reached[row, column]
    return total


@pytest.fixture
def one_thread_then_more() -> Iterator[list[int]]:
    before = numba.get_num_threads()
    yield [1, min(2, numba.config.NUMBA_NUM_THREADS)]
    numba.set_num_threads(before)


@pytest.mark.parametrize("paths", [FOUR_PATHS, EIGHT_PATHS], ids=["four", "eight"])
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize(("small_step", "large_step"), [(4, 40), (10, 10), (0, 3)])
def test_sums_are_those_of_the_twin(
    shape: tuple[int, int, int], paths: np.ndarray, small_step: int, large_step: int
) -> None:
    costs, view = volume(*shape), volume(*shape[:2], seed=1, most=120)
    found = aggregate(costs, view, paths, small_step, large_step)
    assert found.dtype == np.uint16
    np.testing.assert_array_equal(found, twin(costs, view, paths, small_step, large_step))


def test_number_of_threads_changes_nothing(one_thread_then_more: list[int]) -> None:
    costs, view = volume(50, 70, 32), volume(50, 70, seed=1, most=256)
    sums = []
    for threads in one_thread_then_more:
        numba.set_num_threads(threads)
        sums.append(aggregate(costs, view, EIGHT_PATHS, 4, 40).tobytes())
    assert sums[0] == sums[1]


def test_neighbours_settle_what_a_pixel_leaves_open() -> None:
    """All pixels but one favour hypothesis 6; that one slightly favours 2."""
    costs = np.full((9, 9, 12), 30, np.uint8)
    costs[:, :, 6] = 5
    costs[4, 4] = 20
    costs[4, 4, [2, 6]] = 10, 12
    even = np.full((9, 9), 100, np.uint8)
    assert aggregate(costs, even, EIGHT_PATHS, 4, 40)[4, 4].argmin() == 6
    assert aggregate(costs, even, EIGHT_PATHS, 0, 0)[4, 4].argmin() == 2


def test_depth_changes_where_the_grey_level_does() -> None:
    """Between two sides that are sure, columns that could be either go with those of their own grey level."""
    costs = np.full((10, 20, 16), 24, np.uint8)
    costs[:, :5, 3] = costs[:, -5:, 12] = 0
    for border in (7, 13):
        view = np.where(np.arange(20) < border, 40, 200).astype(np.uint8) * np.ones((10, 1), np.uint8)
        found = aggregate(costs, view, EIGHT_PATHS, 4, 40).argmin(axis=2)
        expected = np.where(np.arange(20) < border, 3, 12)
        np.testing.assert_array_equal(found, np.tile(expected, (10, 1)))


@given(steps=st.integers(2, 12), vertex=st.floats(1.5, 13.5), lift=st.integers(0, 500))
def test_vertex_of_a_parabola_is_found(steps: int, vertex: float, lift: int) -> None:
    """Of one with integer samples, to rounding."""
    numerator = round(vertex * steps)
    total = ((steps * np.arange(16) - numerator) ** 2 + lift).astype(np.uint16).reshape(1, 1, 16)
    inverse_depths = np.linspace(0.2, 1.7, 16, dtype=np.float32)
    depths, _ = winners(total, inverse_depths, 8)
    assert 1 / depths[0, 0] == pytest.approx(0.2 + 0.1 * numerator / steps, rel=1e-5)


def test_a_winner_at_the_near_end_of_the_range_is_none() -> None:
    total = (10 * np.abs(np.arange(16) - 15) + 3).astype(np.uint16).reshape(1, 1, 16)
    depths, margins = winners(total, np.linspace(0.2, 1.7, 16, dtype=np.float32), 8)
    assert (depths[0, 0], margins[0, 0]) == (0, 0)


def test_a_winner_at_the_far_end_of_the_range_is_that_end() -> None:
    total = (10 * np.arange(16) + 3).astype(np.uint16).reshape(1, 1, 16)
    depths, margins = winners(total, np.linspace(0.2, 1.7, 16, dtype=np.float32), 8)
    assert depths[0, 0] == pytest.approx(1 / 0.2)
    assert margins[0, 0] > 0


def test_margin_is_the_share_by_which_the_winner_is_cheaper_than_its_best_rival() -> None:
    total = np.full((1, 3, 16), 400, np.uint16)
    total[0, 0, [3, 9]] = 200, 250
    total[0, 1, [3, 9]] = 200, 200
    # Nearly as cheap, but as near as what belongs to the same valley.
    total[0, 2, [3, 3 + RIVAL_DISTANCE]] = 200, 210
    _, margins = winners(total, np.linspace(0.2, 1.7, 16, dtype=np.float32), 8)
    np.testing.assert_allclose(margins[0], [0.2, 0.0, 0.5], atol=1e-6)


@pytest.mark.parametrize("paths", [4, 8])
def test_margins_of_costs_that_noise_explains_are_shares_of_the_noise(paths: int) -> None:
    total = np.full((1, 1, 16), 30, np.uint16)
    total[0, 0, 5] = 10
    _, margins = winners(total, np.linspace(0.2, 1.7, 16, dtype=np.float32), paths)
    assert margins[0, 0] == pytest.approx(20 / (NOISE * paths))


def test_costs_that_are_all_alike_have_no_winner() -> None:
    depths, margins = winners(np.full((2, 3, 8), 7, np.uint16), np.linspace(0.2, 0.9, 8, dtype=np.float32), 8)
    assert not depths.any()
    assert not margins.any()
