"""The pace of a run: its length, learning rates, and training views."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from pocketgs.splat.engine import Engine
from pocketgs.splat.settings import LearningRates
from pocketgs.training.recipes import Schedule
from pocketgs.training.validation import Course


class Pace(Protocol):
    """Queried by the training loop before every step, and updated after it.

    Iterations are counted from 0 before the first step. `seconds` are since training began in this process.
    """

    @property
    def iterations(self) -> int:
        """End of the run, as far as it is known."""

    @property
    def course(self) -> Course | None:
        """State that checkpoints must contain, or None."""

    def fraction(self, iteration: int, seconds: float) -> float:
        """Progress from 0 to 1, by iterations or by time."""

    def rates(self, iteration: int, seconds: float) -> LearningRates:
        """The learning rates of the step after `iteration` steps."""

    def views(self, iteration: int) -> Sequence[int]:
        """Indices of the training views in an epoch."""

    def after_step(self, iteration: int, seconds: float, engine: Engine) -> None:
        """Called after step number `iteration`; may evaluate the scene."""


class SetPace:
    """A run with a fixed number of iterations, or seconds, whichever ends first.

    Args:
        iterations: of the run.
        seconds: maximum training time, or None.
        schedule: of the learning rates.
        initial: initial learning rates.
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
        """Progress by iterations, or by time if that is further along."""
        by_time = 0.0 if self._seconds is None else seconds / self._seconds if self._seconds > 0 else 1.0
        return min(max(iteration / self._iterations, by_time), 1.0)

    def rates(self, iteration: int, seconds: float) -> LearningRates:
        """As in the schedule."""
        return self._schedule(self._initial, self.fraction(iteration, seconds))

    def views(self, iteration: int) -> Sequence[int]:
        """All views."""
        return self._views

    def after_step(self, iteration: int, seconds: float, engine: Engine) -> None:
        """Nothing."""
