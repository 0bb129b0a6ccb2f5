"""Strategies by name, and their initial numbers of Gaussians."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, get_args

from pocketgs.training.strategies.adc import AdaptiveDensityControl
from pocketgs.training.strategies.budgeted import Budgeted, Growth
from pocketgs.training.strategies.fixed import Fixed
from pocketgs.training.strategies.mcmc import MCMC
from pocketgs.training.strategies.strategy import Strategy, StrategyContext

StrategyName = Literal["fixed", "adc", "mcmc", "budgeted"]

STRATEGIES = get_args(StrategyName)

LEAST_START = 4


@dataclass(frozen=True)
class _Kind:
    make: Callable[[StrategyContext], Strategy]
    first: float
    """Maximum initial number of Gaussians, as a share of the final number."""


FIRST_OPEN_ENDED = 0.5
"""The same for an open-ended run, if its strategy grows: it may end before it reaches the maximum."""

_KINDS: dict[str, _Kind] = {
    "fixed": _Kind(Fixed, 1.0),
    "adc": _Kind(AdaptiveDensityControl, 0.5),
    "mcmc": _Kind(MCMC, 0.5),
    "budgeted": _Kind(Budgeted, Growth().first),
}


def create_strategy(name: StrategyName, context: StrategyContext) -> Strategy:
    """Create a strategy."""
    return _KINDS[name].make(context)


def most_at_start(name: StrategyName, most: int, open_ended: bool = False) -> int:
    """Maximum initial number of Gaussians of a run of at most `most`."""
    first = _KINDS[name].first
    first = min(first, FIRST_OPEN_ENDED) if open_ended and first < 1.0 else first
    return max(int(first * most), min(LEAST_START, most))
