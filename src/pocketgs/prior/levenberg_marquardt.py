"""Levenberg-Marquardt for costs that can be linearised: how far to trust a step, and when to stop."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

State = TypeVar("State")

FIRST_DAMPING = 1e-4
MIN_DAMPING = 1e-12
NEGLIGIBLE = 1e-15
"""A decrease of the cost by less is rounding, where residuals are pixels."""


@dataclass(frozen=True)
class Outcome(Generic[State]):
    """Where a minimisation ended.

    Attributes:
        state: of the least cost seen.
        cost_before, cost: at the start and at `state`; the latter is never larger.
        iterations: steps tried.
        converged: whether a step could not be expected to gain more than the tolerance.
    """

    state: State
    cost_before: float
    cost: float
    iterations: int
    converged: bool


def minimise(
    start: State,
    cost: Callable[[State], float],
    step: Callable[[State, float], tuple[State, float]],
    iterations: int,
    tolerance: float,
) -> Outcome[State]:
    """Find a minimum near `start`, damping by Nielsen's rule.

    Madsen, Nielsen and Tingleff, "Methods for non-linear least squares problems" (2004), algorithm 3.16.

    Args:
        start: where to begin.
        cost: of a state.
        step: (state, damping) to the state that the damped linear model leads to, and by how much that model expects
            the cost to fall. It raises `numpy.linalg.LinAlgError` where it finds none.
        iterations: at most as many steps are tried.
        tolerance: stop when the expected decrease, or that of a successful step, is below this times the cost.
    """
    state = start
    cost_before = least = cost(start)
    damping, growth = FIRST_DAMPING, 2.0
    for iteration in range(1, iterations + 1):
        enough = tolerance * least + NEGLIGIBLE
        try:
            candidate, expected = step(state, damping)
        except np.linalg.LinAlgError:
            damping, growth = damping * growth, growth * 2.0
            continue
        if expected <= enough:
            return Outcome(state, cost_before, least, iteration, True)
        reached = cost(candidate)
        decrease = least - reached
        if decrease > 0.0:
            state, least = candidate, reached
            if decrease <= enough:
                return Outcome(state, cost_before, least, iteration, True)
            damping = max(damping * max(1.0 / 3.0, 1.0 - (2.0 * decrease / expected - 1.0) ** 3), MIN_DAMPING)
            growth = 2.0
        else:
            damping, growth = damping * growth, growth * 2.0
    return Outcome(state, cost_before, least, iterations, False)
