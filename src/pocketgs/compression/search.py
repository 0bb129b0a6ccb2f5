"""The search for a number of Gaussians: the fewest of sufficient quality, or the most that fit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

TRIES = 5
"""Maximum number of candidates of a search."""

CLOSE = 0.03
"""Relative precision of the number of Gaussians that ends the search."""

UNUSUAL = 3.0
"""Maximum factor between the measured slope of the values and the expected one: values are noisy."""


@dataclass(frozen=True)
class Goal:
    """The goal of a search.

    Attributes:
        target: the value to reach with the fewest Gaussians, or not to exceed with the most.
        slope: expected growth of the value if the number of Gaussians grows by a factor of e.
        tolerance: a value this close to the target, on its right side, ends the search.
        from_above: whether the value must be at least the target; otherwise it must be at most the target.
    """

    target: float
    slope: float
    tolerance: float
    from_above: bool

    def met_by(self, value: float) -> bool:
        """Whether a value is on the right side of the target."""
        return value >= self.target if self.from_above else value <= self.target


def search(
    value_of: Callable[[int], float],
    goal: Goal,
    guess: int,
    least: int,
    most: int,
    is_time_up: Callable[[], bool] = lambda: False,
) -> None:
    """Try numbers of Gaussians until two close ones bracket the target; values must grow with the number.

    Args:
        value_of: makes the candidate with a number of Gaussians, keeps it, and returns its value.
        goal: of the search.
        guess: the first number to try.
        least: minimum number.
        most: maximum number.
        is_time_up: called after every number; whether the search must end.
    """
    low, high = np.log(least) - CLOSE, np.log(most) + CLOSE
    place = float(np.clip(np.log(guess), np.log(least), np.log(most)))
    tried: list[tuple[float, float]] = []
    for _ in range(TRIES):
        value = value_of(max(round(np.exp(place)), 1))
        tried.append((place, value))
        low, high = (max(low, place), high) if value < goal.target else (low, min(high, place))
        if goal.met_by(value) and abs(value - goal.target) <= goal.tolerance:
            return
        if high - low <= 2 * CLOSE or is_time_up():
            return
        # Aim at the middle of the tolerance, since the values are noisy.
        aim = goal.target + (0.5 if goal.from_above else -0.5) * goal.tolerance
        place = float(np.clip(place + (aim - value) / _slope(tried, goal.slope), low + CLOSE, high - CLOSE))


def _slope(tried: list[tuple[float, float]], expected: float) -> float:
    """Slope between the last two places tried, within `UNUSUAL` of the expected one; after one place, that one."""
    if len(tried) < 2:
        return expected
    (before, value_before), (place, value) = tried[-2:]
    found = (value - value_before) / (place - before)
    return float(np.clip(found, expected / UNUSUAL, expected * UNUSUAL))
