"""The pace of a run: when it ends, how far its learning rates have fallen, and which views it trains on."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from pocketgs.splat.engine import Engine
from pocketgs.splat.settings import LearningRates
from pocketgs.training.recipes import Schedule
from pocketgs.training.validation import Course


class Pace(Protocol):
    """Asked by the loop before every step, and told after it.

    Iterations are counted from 0 before the first step. `seconds` are those since training began, in this process.
    """

    @property
    def iterations(self) -> int:
        """At which the run ends, as far as is known now."""

    @property
    def course(self) -> Course | None:
        """What it has learnt on the way and a checkpoint must keep, or None."""

    def fraction(self, iteration: int, seconds: float) -> float:
        """How much of the run is over, from 0 to 1, by iterations or by time."""

    def rates(self, iteration: int, seconds: float) -> LearningRates:
        """The learning rates of the step after `iteration` steps."""

    def views(self, iteration: int) -> Sequence[int]:
        """Indices of the training views that an epoch consists of."""

    def after_step(self, iteration: int, seconds: float, engine: Engine) -> None:
        """Look at the scene, if it is time to, after `iteration` steps."""


class SetPace:
    """A run of a given number of iterations, or of seconds, whichever are over first.

    Args:
        iterations: of the run.
        seconds: that it may take, or None.
        schedule: how the rates fall.
        initial: the rates at its start.
        views: number of training views.
    """

    def __init__(
        self, iterations: int, seconds: float | None, schedule: Schedule, initial: LearningRates, views: int
    ) -> None:
        self._iterations, self._seconds, self._views = iterations, seconds, range(views)
        self._schedule, self._initial = schedule, initial

    @property
    def iterations(self) -> int:
        """As given."""
        return self._iterations

    @property
    def course(self) -> None:
        """None."""

    def fraction(self, iteration: int, seconds: float) -> float:
        """Of the iterations, or of the seconds."""
        by_time = 0.0 if self._seconds is None else seconds / self._seconds if self._seconds > 0 else 1.0
        return min(max(iteration / self._iterations, by_time), 1.0)

    def rates(self, iteration: int, seconds: float) -> LearningRates:
        """Those of the schedule."""
        return self._schedule(self._initial, self.fraction(iteration, seconds))

    def views(self, iteration: int) -> Sequence[int]:
        """All of them."""
        return self._views

    def after_step(self, iteration: int, seconds: float, engine: Engine) -> None:
        """Nothing."""
