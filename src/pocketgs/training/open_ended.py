"""A run that goes on as long as it pays.

It explores in stages, each a third longer than all before it together were long: a stage whose validation views gain
less than MIN_GAIN was not worth its time. Then the rates fall to the end, and validation views are trained on too. So
the length of a run follows from the capture, in proportion to itself, and from no machine's speed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from pocketgs.capture.capture import Frame
from pocketgs.splat.engine import Engine
from pocketgs.splat.settings import LearningRates
from pocketgs.training.validation import Course, Look, validation_psnr, validation_views

FIRST_STAGE, STAGE_RATIO = 500, 4 / 3
"""Iterations of the first stage, and how many times later each of the next ends."""

MIN_GAIN = 0.05
"""Decibels that a third more iterations must win."""

DECAY = 0.5
"""Iterations over which rates fall at the end, as a share of those before."""

LAST_RATES = 0.02
"""What the rates fall to, as a share of those from which they fall."""

GROWTH = 1.25
"""By how much the number of Gaussians grows after a stage that has paid."""

SLOWS_FROM = 500
"""Iterations after which rates begin to fall with the square root of the iterations done: nobody knows the run's length
yet, and noise that averages out over many steps asks for smaller ones (Robbins and Monro 1951)."""


class OpenEndedPace:
    """See the module; also says when, and to what number, the strategy `budgeted` grows.

    Args:
        iterations: most of the run.
        seconds: that it may take, or None.
        initial: learning rates at its start.
        frames: the training views, enough of them for `validation_views`.
        background: that they are rendered over.
        most: Gaussians that there may be.
        course: of the run that goes on.
    """

    def __init__(
        self,
        iterations: int,
        seconds: float | None,
        initial: LearningRates,
        frames: Sequence[Frame],
        background: tuple[float, float, float],
        most: int,
        course: Course | None,
    ) -> None:
        self._course = course or Course()
        self._longest, self._seconds, self._initial, self._most = iterations, seconds, initial, most
        held_back = validation_views(len(frames))
        self._validation, self._background = [frames[index] for index in held_back], background
        self._all = range(len(frames))
        self._shown = [index for index in self._all if index not in held_back]
        self._stages = stages(int(iterations / (1.0 + DECAY)))

    @property
    def course(self) -> Course:
        """Looks at the validation views, and what was decided."""
        return self._course

    @property
    def iterations(self) -> int:
        """At which the run ends if the stage under way does not pay."""
        decays_from = self.course.decays_from
        if decays_from is None:
            looked = len(self.course.looks)
            decays_from = self._stages[min(looked, len(self._stages) - 1)]
        return max(min(round(decays_from * (1.0 + DECAY)), self._longest), decays_from + 1)

    def fraction(self, iteration: int, seconds: float) -> float:
        """Of the iterations that the run has as far as is known, or of the seconds."""
        by_time = 0.0 if self._seconds is None else seconds / self._seconds if self._seconds > 0 else 1.0
        return min(max(iteration / self.iterations, by_time), 1.0)

    def rates(self, iteration: int, seconds: float) -> LearningRates:
        """Constant, then slowly falling; at the end along half a cosine."""
        decays_from = self.course.decays_from
        reached = iteration if decays_from is None else decays_from
        factor = math.sqrt(SLOWS_FROM / max(reached, SLOWS_FROM))
        if decays_from is not None:
            done = (iteration - decays_from) / (self.iterations - decays_from)
            if self._seconds:
                before = 1.0 / (1.0 + DECAY)
                done = max(done, (seconds / self._seconds - before) / (1.0 - before))
            factor *= LAST_RATES + (1.0 - LAST_RATES) * 0.5 * (1.0 + math.cos(math.pi * min(max(done, 0.0), 1.0)))
        return self._initial.scaled(factor)

    def views(self, iteration: int) -> Sequence[int]:
        """All but the validation views as long as it explores, then all."""
        return self._shown if self.course.decays_from is None else self._all

    def after_step(self, iteration: int, seconds: float, engine: Engine) -> None:
        """At the end of a stage look at the validation views; decide when rates begin to fall."""
        if self.course.decays_from is not None:
            return
        if iteration in self._stages:
            value = validation_psnr(engine, self._validation, self._background)
            self._course = self.course.with_look(Look(iteration, value, engine.count, seconds))
        is_late = self._seconds is not None and seconds >= self._seconds / (1.0 + DECAY)
        gain = self.course.gain if iteration in self._stages else None
        if is_late or iteration >= self._stages[-1] or (gain is not None and not gain >= MIN_GAIN):
            self._course = replace(self.course, decays_from=iteration)

    def next_growth(self, iteration: int) -> int | None:
        """The first iteration, from this one on, after which Gaussians may multiply."""
        if self.course.decays_from is not None:
            return None
        return next((stage for stage in self._stages if stage >= iteration), None)

    def target(self, iteration: int, count: int) -> int:
        """How many of `count` Gaussians there are to be."""
        return min(int(GROWTH * count), self._most)


def stages(last: int) -> list[int]:
    """Iterations at which stages end, at most `last`, with which the last stage ends."""
    ends, end = [], float(FIRST_STAGE)
    while round(end) < last:
        ends.append(round(end))
        end *= STAGE_RATIO
    return [*ends, max(last, 1)]
