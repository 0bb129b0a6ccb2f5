"""What a strategy is: asked before every step what to collect, and given the engine after it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from pocketgs.splat.engine import Engine
from pocketgs.splat.settings import LossSettings, PositionNoise


class GrowthPlan(Protocol):
    """When Gaussians multiply, and to what number."""

    def next_growth(self, iteration: int) -> int | None:
        """The first iteration, from this one on, after which Gaussians multiply; None if they will not."""

    def target(self, iteration: int, count: int) -> int:
        """How many there may be after this iteration, where there are `count` before."""


@dataclass(frozen=True)
class Situation:
    """What a strategy knows of its run. All that is random follows from the seed and the iteration.

    Attributes:
        iterations: of the run.
        most: Gaussians that it may come to have.
        measure_extent: gives 3DGS's measure of the scene, see `pocketgs.training.recipes.camera_extent`.
        views: number of training views.
        seed: of everything random.
        bright: whether the background is not black.
        growth: what the run knows of when to grow, or None where that is the strategy's to say.
    """

    iterations: int
    most: int
    measure_extent: Callable[[], float]
    views: int
    seed: int = 0
    bright: bool = False
    growth: GrowthPlan | None = None

    def random(self, iteration: int) -> np.random.Generator:
        """Random numbers of an iteration."""
        return np.random.default_rng((self.seed, iteration, 1))


@dataclass(frozen=True)
class Collected:
    """What a step is to collect: see `StepSettings`."""

    statistics: bool = False
    errors: bool = False
    absolute: bool = False


class Strategy(Protocol):
    """Decides which Gaussians go, stay and multiply.

    It keeps nothing from one iteration to the next but what the engine holds, so that a resumed run ends as an unbroken
    one.
    """

    name: str

    def collected(self, iteration: int) -> Collected:
        """What the step that ends iteration `iteration`, counted from 1, is to collect."""

    def loss(self, loss: LossSettings) -> LossSettings:
        """The recipe's loss with what the strategy adds to it."""

    def noise(self, iteration: int, slowness: float) -> PositionNoise | None:
        """What positions are shaken by in a step; `slowness` is how far the rate of the means has fallen, 1 to 0."""

    def after_step(self, iteration: int, engine: Engine) -> None:
        """Change the rows of the engine, or leave them."""


class Quiet:
    """What a strategy does that neither adds to the loss nor shakes positions."""

    def loss(self, loss: LossSettings) -> LossSettings:
        """The recipe's."""
        return loss

    def noise(self, iteration: int, slowness: float) -> PositionNoise | None:
        """None."""
        return None
