"""Open-ended training: a run that continues as long as the validation PSNR improves.

It explores in stages, each of which adds a third to the iterations so far. When PATIENCE stages in a row have gained
less than MIN_GAIN on the validation views, the exploration ends, unless the run would be shorter than with a length
chosen by size: in the first stages of a capture with many views, each has been visited only a few times, and gains are
noise. Then the learning rates decay, and the validation views are trained on too. So the length of a run depends on the
capture, and not on the speed of the machine.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pocketgs.capture.capture import Frame
from pocketgs.scene.background import Background
from pocketgs.splat.engine import Engine
from pocketgs.splat.settings import LearningRates
from pocketgs.training.pace import share_of_time
from pocketgs.training.transients import FIRST_EPOCHS
from pocketgs.training.validation import (
    ValidationHistory,
    ValidationSample,
    mean_psnr,
    validation_views,
    validation_views_of_few,
)

FIRST_STAGE, STAGE_RATIO = 500, 4 / 3
"""Iterations of the first stage, and the ratio between the ends of consecutive stages."""

MIN_GAIN = 0.05
"""Minimum gain in dB over the best stage before."""

PATIENCE = 2
"""Stages without it that end the exploration: while rates are high, PSNR goes up and down by some tenths of a dB."""

DECAY = 0.5
"""Length of the final decay, relative to the iterations before it."""

LAST_RATES = 0.02
"""Final learning rates, relative to those at the start of the decay."""

GROWTH = 1.25
"""Growth factor of the number of Gaussians after every stage."""

SLOWS_FROM = 500
"""Iterations after which rates decay with the inverse square root of the iteration: the length of the run is unknown,
and averaging noise over many steps needs smaller rates (Robbins and Monro 1951)."""


class OpenEndedPace:
    """The pace of open-ended training; it also schedules the growth of the strategy `budgeted`.

    Args:
        least, iterations: minimum number, unless time is short, and maximum number.
        seconds: maximum training time, or None.
        initial: initial learning rates.
        frames: the training views. Some may have been dropped since `validation_views` found them enough.
        background: of the renderings.
        most: maximum number of Gaussians.
        history: of the run to resume, or None.
    """

    def __init__(
        self,
        least: int,
        iterations: int,
        seconds: float | None,
        initial: LearningRates,
        frames: Sequence[Frame],
        background: Background,
        most: int,
        history: ValidationHistory | None,
    ) -> None:
        self._history = history or ValidationHistory()
        self._seconds_before = self._history.samples[-1].seconds if self._history.samples else 0.0
        self._longest, self._seconds, self._initial, self._most = iterations, seconds, initial, most
        held_back = validation_views(len(frames)) or validation_views_of_few(len(frames))
        self._validation, self._background = [frames[index] for index in held_back], background
        self._all = range(len(frames))
        self._shown = [index for index in self._all if index not in held_back]
        self._stages = stages(int(iterations / (1.0 + DECAY)))
        self._may_end_from = next((end for end in self._stages if _end(end, iterations) >= least), self._stages[-1])

    @property
    def history(self) -> ValidationHistory:
        """Evaluations on the validation views, and decisions."""
        return self._history

    @property
    def iterations(self) -> int:
        """End of the run if the current stage does not gain enough."""
        next_stage = self._stages[min(len(self.history.samples), len(self._stages) - 1)]
        return end_of(self.history, self._longest) or _end(max(next_stage, self._may_end_from), self._longest)

    def fraction(self, iteration: int, seconds: float) -> float:
        """Progress by iterations, as far as they are known, or by time."""
        return min(max(iteration / self.iterations, share_of_time(seconds, self._seconds)), 1.0)

    def rates(self, iteration: int, seconds: float) -> LearningRates:
        """Constant at first, then slowly decaying; at the end a half cosine."""
        decays_from = self.history.decays_from
        reached = iteration if decays_from is None else decays_from
        factor = math.sqrt(SLOWS_FROM / max(reached, SLOWS_FROM))
        if decays_from is not None:
            done = (iteration - decays_from) / (self.iterations - decays_from)
            before = 1.0 / (1.0 + DECAY)
            done = max(done, (share_of_time(seconds, self._seconds) - before) / (1.0 - before))
            factor *= LAST_RATES + (1.0 - LAST_RATES) * 0.5 * (1.0 + math.cos(math.pi * min(max(done, 0.0), 1.0)))
        return self._initial.scaled(factor)

    def views(self, iteration: int) -> Sequence[int]:
        """All but the validation views during exploration, all of them afterwards."""
        return self._shown if self.history.decays_from is None else self._all

    def familiar_views(self, iteration: int) -> Sequence[int]:
        """All but the validation views, until these have been visited FIRST_EPOCHS times."""
        decays_from = self.history.decays_from
        # One more, since the decay may begin in the middle of an epoch.
        is_early = decays_from is None or iteration < decays_from + (FIRST_EPOCHS + 1) * len(self._all)
        return self._shown if is_early else self._all

    def after_step(self, iteration: int, seconds: float, engine: Engine) -> None:
        """Evaluate the validation views at the end of a stage, and decide whether to start the decay."""
        if self.history.decays_from is not None:
            return
        if iteration in self._stages and self._validation:
            value = mean_psnr(engine, self._validation, self._background)
            self._history = self.history.with_sample(
                ValidationSample(iteration, value, engine.count, self._seconds_before + seconds)
            )
        is_late = share_of_time(seconds, self._seconds) >= 1.0 / (1.0 + DECAY)
        may_end = iteration in self._stages and iteration >= self._may_end_from
        pays = bool(self._validation) and _pays(self.history.samples)
        if is_late or iteration >= self._stages[-1] or (may_end and not pays):
            self._history = replace(self.history, decays_from=iteration)

    def next_growth(self, iteration: int) -> int | None:
        """The first iteration, from this one on, after which Gaussians may be added."""
        if self.history.decays_from is not None:
            return None
        return next((stage for stage in self._stages if stage >= iteration), None)

    def target(self, iteration: int, count: int) -> int:
        """Number of Gaussians to grow to from `count`."""
        return min(int(GROWTH * count), self._most)


def _pays(samples: Sequence[ValidationSample]) -> bool:
    """Whether one of the last stages was worth it, or it is too early to say."""
    before, last = [sample.psnr for sample in samples[:-PATIENCE]], [sample.psnr for sample in samples[-PATIENCE:]]
    return bool(np.isfinite(last).all()) and (not before or max(last) >= max(before) + MIN_GAIN)


def end_of(history: ValidationHistory, longest: int) -> int | None:
    """The iteration at which a run ends, or None while that is undecided; at most `longest`."""
    return None if history.decays_from is None else _end(history.decays_from, longest)


def _end(decays_from: int, longest: int) -> int:
    return max(min(round(decays_from * (1.0 + DECAY)), longest), decays_from + 1)


def stages(last: int) -> list[int]:
    """Iterations at which stages end, the last at `last`."""
    ends, end = [], float(FIRST_STAGE)
    while round(end) < last:
        ends.append(round(end))
        end *= STAGE_RATIO
    return [*ends, max(last, 1)]
