"""The `Strategy` interface: called before every step for its settings, and after it with the engine."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from pocketgs.splat.engine import Engine
from pocketgs.splat.settings import LossSettings, PositionNoise


class GrowthPlan(Protocol):
    """A schedule of the number of Gaussians."""

    def next_growth(self, iteration: int) -> int | None:
        """The next iteration, from this one on, after which the number grows; None if it will not."""

    def target(self, iteration: int, count: int) -> int:
        """Maximum number of Gaussians after this iteration, given the current `count`."""


@dataclass(frozen=True)
class StrategyContext:
    """The run that a strategy is for. Everything random is determined by the seed and the iteration.

    Attributes:
        iterations: of the run, as far as it can be planned.
        most: maximum number of Gaussians.
        measure_extent: returns 3DGS's extent of the scene, see `pocketgs.training.recipes.camera_extent`.
        views: number of training views.
        seed: random seed.
        bright: whether the background is not black.
        published_times: whether strategies act at the iterations of their papers, which ran for 30,000; otherwise the
            times of shorter runs are scaled to their length.
        growth: the run's schedule of growth, or None if the strategy chooses its own.
    """

    iterations: int
    most: int
    measure_extent: Callable[[], float]
    views: int
    seed: int = 0
    bright: bool = False
    published_times: bool = False
    growth: GrowthPlan | None = None

    def random(self, iteration: int) -> np.random.Generator:
        """Random number generator of an iteration."""
        return np.random.default_rng((self.seed, iteration, 1))


@dataclass(frozen=True)
class Collected:
    """Statistics to collect in a step; see `StepSettings`."""

    statistics: bool = False
    errors: bool = False


class Strategy(Protocol):
    """Controls the number of Gaussians.

    It has no state of its own: the engine holds all statistics, so that a resumed run ends like an uninterrupted one.

    Attributes:
        name: of the strategy.
        changes_rows: whether it ever changes the number of Gaussians, so that a checkpoint needs the statistics.
    """

    name: str
    changes_rows: bool

    def collected(self, iteration: int) -> Collected:
        """Statistics to collect in the step that ends iteration `iteration`, counted from 1."""

    def loss(self, loss: LossSettings) -> LossSettings:
        """The recipe's loss, with the strategy's regularisers."""

    def noise(self, iteration: int, slowness: float) -> PositionNoise | None:
        """Noise on positions in a step; `slowness` is the learning rate of the means relative to its initial value."""

    def after_step(self, iteration: int, engine: Engine) -> None:
        """Change the engine's rows, if it is time."""


class StrategyDefaults:
    """Defaults for strategies without regularisers and noise."""

    def loss(self, loss: LossSettings) -> LossSettings:
        """The recipe's loss, unchanged."""
        return loss

    def noise(self, iteration: int, slowness: float) -> PositionNoise | None:
        """None."""
        return None
