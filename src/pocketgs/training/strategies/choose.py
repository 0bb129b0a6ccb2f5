"""Strategies by name, and with how many Gaussians each begins."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, get_args

from pocketgs.training.strategies.adc import AdaptiveDensityControl
from pocketgs.training.strategies.budgeted import Budgeted, Growth
from pocketgs.training.strategies.fixed import Fixed
from pocketgs.training.strategies.mcmc import MarkovChain
from pocketgs.training.strategies.strategy import Situation, Strategy

StrategyName = Literal["fixed", "adc", "mcmc", "budgeted"]

STRATEGIES = get_args(StrategyName)

FEWEST_GAUSSIANS = 4


@dataclass(frozen=True)
class _Kind:
    make: Callable[[Situation], Strategy]
    first: float
    """Share of the final number that a run may begin with."""


_KINDS: dict[str, _Kind] = {
    "fixed": _Kind(Fixed, 1.0),
    "adc": _Kind(AdaptiveDensityControl, 0.5),
    "mcmc": _Kind(MarkovChain, 0.5),
    "budgeted": _Kind(Budgeted, Growth().first),
}


def create_strategy(name: StrategyName, situation: Situation) -> Strategy:
    """Make a strategy."""
    return _KINDS[name].make(situation)


def most_at_start(name: StrategyName, most: int) -> int:
    """How many Gaussians a run of at most `most` may begin with."""
    return max(int(_KINDS[name].first * most), min(FEWEST_GAUSSIANS, most))
