"""Levenberg-Marquardt minimisation: damping and stopping, for any cost that can be linearised."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

State = TypeVar("State")

FIRST_DAMPING = 1e-4
MIN_DAMPING = 1e-12
NEGLIGIBLE = 1e-15
"""Smaller decreases of the cost are rounding errors, for residuals in pixels."""


@dataclass(frozen=True)
class Outcome(Generic[State]):
    """The result of a minimisation.

    Attributes:
        state: of lowest cost.
        cost_before, cost: at the start and at `state`; the latter is never larger.
        iterations: number of steps tried.
        converged: whether no step was expected to gain more than the tolerance.
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
    """Find a local minimum near `start`, with Nielsen's damping rule.

    Madsen, Nielsen and Tingleff, "Methods for non-linear least squares problems" (2004), algorithm 3.16.

    Args:
        start: initial state.
        cost: function of a state.
        step: maps (state, damping) to the state after the damped linear step, and the decrease of the cost that the
            linear model predicts. It raises `numpy.linalg.LinAlgError` if it finds none.
        iterations: maximum number of steps.
        tolerance: stop when the predicted decrease, or that of a successful step, is below this times the cost.
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
