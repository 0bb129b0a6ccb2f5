"""Steps submitted to the GPU ahead of time: the host checks from time to time how many are completed."""

from __future__ import annotations

import math
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
"""Maximum number of pending steps, of those with streamed photographs, and of seconds of pending work, before the host
checks which steps are completed. Streamed steps are fewer, since each holds a copy of its photograph."""

MIN_SECONDS = 1e-6
"""Minimum measured time of a step: clocks may be too coarse to measure one."""


@dataclass(frozen=True)
class Step:
    """A submitted step that may not be completed."""

    view: int
    settings: StepSettings


class StepsAhead:
    """The submitted steps, and the number of completed ones.

    A step whose tile lists do not fit into their buffers changes nothing, and neither do the steps after it. They are
    submitted again once the buffers are large enough.

    Args:
        executor: its buffer `status` holds the GPU's progress; see `common/update.wgsl`.

    Attributes:
        completed: number of completed steps, including those before this run was resumed.
        most: number of steps that are submitted before the host checks.
    """

    def __init__(self, executor: Executor) -> None:
        self._executor = executor
        self._pending: list[Step] = []
        self._first_pending = 0.0
        self.completed = self._completed_before = 0
        # The host checks after each step until it has measured how long one takes.
        self.most = 1

    @property
    def next_number(self) -> int:
        """Number of the step that is submitted next, counted from 1."""
        return self.completed + len(self._pending) + 1

    def restart(self, completed: int) -> None:
        """Forget all steps, and set the number of completed ones."""
        self._pending.clear()
        self.completed = self._completed_before = completed
        self.resume()

    def resume(self) -> None:
        """Tell the GPU the number of completed steps, and that it may go on."""
        self._executor.write("status", np.array([self.completed, 0, 0], np.uint32))

    def add(self, step: Step) -> None:
        """Record a submitted step."""
        if not self._pending:
            self._first_pending = time.monotonic()
        self._pending.append(step)

    def are_enough(self, streamed: bool) -> bool:
        """Whether enough steps are pending for the host to check."""
        return len(self._pending) >= (min(self.most, MAX_STREAMED) if streamed else self.most)

    def settle(self, submit: Callable[[Step], None], make_room: Callable[[int], None]) -> None:
        """Wait until all steps are completed.

        Args:
            submit: submits a step again.
            make_room: makes room for the given number of intersections, and lets the run go on.
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
        """Mean loss of the last `steps` completed steps of this run; NaN before the first."""
        ring = self._executor.read("losses", np.float32, KEPT_LOSSES)
        first = max(self.completed - min(steps, KEPT_LOSSES), self._completed_before)
        if first == self.completed:
            return math.nan
        return float(ring[np.arange(first, self.completed) % KEPT_LOSSES].mean(dtype=np.float64))
