"""The pace of a run: its length, learning rates, and training views."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from pocketgs.splat.engine import Engine
from pocketgs.splat.settings import LearningRates
from pocketgs.training.recipes import Schedule
from pocketgs.training.validation import ValidationHistory


class Pace(Protocol):
    """Queried by the training loop before every step, and updated after it.

    Iterations are counted from 0 before the first step. `seconds` are since training began in this process.
    """

    @property
    def iterations(self) -> int:
        """End of the run, as far as known."""

    @property
    def history(self) -> ValidationHistory | None:
        """State that checkpoints must contain, or None."""

    def fraction(self, iteration: int, seconds: float) -> float:
        """Progress from 0 to 1, by iterations or by time."""

    def rates(self, iteration: int, seconds: float) -> LearningRates:
        """The learning rates of the step after `iteration` steps."""

    def views(self, iteration: int) -> Sequence[int]:
        """Indices of the training views in an epoch."""

    def familiar_views(self, iteration: int) -> Sequence[int]:
        """Those of the views that the scene has been trained on for a while, not only since a few steps."""

    def after_step(self, iteration: int, seconds: float, engine: Engine) -> None:
        """Called after step number `iteration`; may evaluate the scene."""


def share_of_time(seconds: float, budget: float | None) -> float:
    """Share of a time budget that is used, 0 if there is none."""
    if budget is None:
        return 0.0
    return seconds / budget if budget > 0 else 1.0


class SetPace:
    """A run of a given length: a number of iterations, or seconds, whichever ends first.

    Args:
        iterations: of the run.
        seconds: maximum training time, or None.
        schedule: of the learning rates.
        initial: initial learning rates.
        views: number of training views.
        history: of an open-ended run that continues with a given length, or None.
    """

    def __init__(
        self,
        iterations: int,
        seconds: float | None,
        schedule: Schedule,
        initial: LearningRates,
        views: int,
        history: ValidationHistory | None = None,
    ) -> None:
        self._iterations, self._seconds, self._views = iterations, seconds, range(views)
        self._schedule, self._initial, self._history = schedule, initial, history

    @property
    def iterations(self) -> int:
        """The given number."""
        return self._iterations

    @property
    def history(self) -> ValidationHistory | None:
        """The given history."""
        return self._history

    def fraction(self, iteration: int, seconds: float) -> float:
        """Progress by iterations, or by time if that is further along."""
        return min(max(iteration / self._iterations, share_of_time(seconds, self._seconds)), 1.0)

    def rates(self, iteration: int, seconds: float) -> LearningRates:
        """The schedule's rates."""
        return self._schedule(self._initial, self.fraction(iteration, seconds))

    def views(self, iteration: int) -> Sequence[int]:
        """All views."""
        return self._views

    def familiar_views(self, iteration: int) -> Sequence[int]:
        """All views."""
        return self._views

    def after_step(self, iteration: int, seconds: float, engine: Engine) -> None:
        """Does nothing."""
