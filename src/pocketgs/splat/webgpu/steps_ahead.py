"""Steps that are submitted to the GPU ahead of time: the host checks only now and then how far they have got."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pocketgs.gpu.executor import Executor
from pocketgs.splat.engine import KEPT_LOSSES
from pocketgs.splat.settings import StepSettings

MAX_PENDING = 64
MAX_STREAMED = 4
SECONDS_AHEAD = 0.2
"""The GPU has at most so many steps, or so much work, before it: then the host looks whether they were completed. Of
steps whose photographs are streamed there are fewer, since each holds a copy of its own."""

MIN_SECONDS = 1e-6
"""Clocks may tick no faster than a GPU takes its steps."""


@dataclass(frozen=True)
class Step:
    """A step that the GPU may still have before it."""

    view: int
    settings: StepSettings


class StepsAhead:
    """The steps that were submitted, and how many of them are completed.

    A step that needs more room for tiles' lists than there is changes nothing, and neither do those after it: they are
    submitted again once there is room.

    Args:
        executor: whose buffer `status` says how far the GPU is; see `common/update.wgsl`.

    Attributes:
        completed: steps of this run and of those that it goes on from.
        most: steps that are submitted before the host looks.
    """

    def __init__(self, executor: Executor) -> None:
        self._executor = executor
        self._pending: list[Step] = []
        self._first_pending = 0.0
        self.completed = self._completed_before = 0
        # Until it is known how long a step takes, the host looks after each.
        self.most = 1

    @property
    def next_number(self) -> int:
        """Of the step that is submitted next, counted from 1."""
        return self.completed + len(self._pending) + 1

    def restart(self, completed: int) -> None:
        """Forget the steps before; so many count as completed."""
        self._pending.clear()
        self.completed = self._completed_before = completed
        self.resume()

    def resume(self) -> None:
        """Let the GPU know how many steps are completed, and that nothing stands in the way of the next."""
        self._executor.write("status", np.array([self.completed, 0, 0], np.uint32))

    def add(self, step: Step) -> None:
        """A step was submitted."""
        if not self._pending:
            self._first_pending = time.monotonic()
        self._pending.append(step)

    def are_enough(self, streamed: bool) -> bool:
        """Whether it is time to look."""
        return len(self._pending) >= (min(self.most, MAX_STREAMED) if streamed else self.most)

    def settle(self, submit: Callable[[Step], None], make_room: Callable[[int], None]) -> None:
        """Wait until all steps are completed.

        Args:
            submit: submits a step again.
            make_room: makes room for so many intersections, and lets the run go on.
        """
        if not self._pending:
            return
        taken, began = len(self._pending), self._first_pending
        while self._pending:
            completed, halted, needed = self._executor.read("status", np.uint32, 3)
            waiting = self._pending[int(completed) - self.completed :]
            self.completed, self._pending = int(completed), []
            if halted:
                make_room(int(needed))
            for step in waiting:
                submit(step)
        seconds = max(time.monotonic() - began, MIN_SECONDS) / taken
        self.most = int(np.clip(SECONDS_AHEAD / seconds, 1, MAX_PENDING))

    def mean_loss(self, steps: int) -> float:
        """Of the last `steps` completed steps of this run."""
        ring = self._executor.read("losses", np.float32, KEPT_LOSSES)
        first = max(self.completed - min(steps, KEPT_LOSSES), self._completed_before)
        return float(ring[np.arange(first, self.completed) % KEPT_LOSSES].mean(dtype=np.float64))
