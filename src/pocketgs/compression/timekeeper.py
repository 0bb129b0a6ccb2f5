"""Progress and time limit of a compression."""

from __future__ import annotations

import time
from collections.abc import Callable

from pocketgs.system.interrupt import Interrupt


class StoppedError(Exception):
    """Ctrl-C was pressed, or time is up and a file is within the bound."""


class Timekeeper:
    """Counts steps, tells the time left, and says when time is up.

    Args:
        on_count: called with the number of steps done and the expected total.
        interrupt: whether Ctrl-C was pressed.
        seconds: until the work should be done, or None.
    """

    def __init__(self, on_count: Callable[[int, int], None], interrupt: Interrupt, seconds: float | None) -> None:
        self._on_count, self._interrupt, self._seconds = on_count, interrupt, seconds
        self._began = time.monotonic()
        self.done, self.expected = 0, 1
        self.first_speed = float("inf")
        """Steps per second, as long as none is done."""

    def step(self) -> None:
        """Count a step.

        Raises:
            StoppedError: Ctrl-C was pressed.
        """
        self.done += 1
        self._on_count(self.done, max(self.expected, self.done))
        self.check()

    def expect(self, steps: int) -> None:
        """Expect so many more steps."""
        self.expected = self.done + steps

    def check(self) -> None:
        """Raise if the work must stop.

        Raises:
            StoppedError: Ctrl-C was pressed.
        """
        if self._interrupt.requested:
            raise StoppedError

    def elapsed(self) -> float:
        """Seconds since the start."""
        return time.monotonic() - self._began

    def reserve(self, seconds: float) -> None:
        """Reserve time for the work that follows, at most half of the total."""
        if self._seconds is not None:
            self._seconds = max(self._seconds - seconds, 0.5 * self._seconds)

    def used(self) -> float:
        """Share of the time that is used, 0 without a limit."""
        return 0.0 if self._seconds is None else self.elapsed() / max(self._seconds, 1e-3)

    def seconds_left(self) -> float:
        """Seconds until the time limit, less than 0 after it; infinite without one."""
        return float("inf") if self._seconds is None else self._seconds - self.elapsed()

    def is_up(self) -> bool:
        """Whether the time limit is reached."""
        return self.used() >= 1.0

    def steps_left(self) -> float:
        """Number of steps that fit into the remaining time, at the speed so far; infinite without a limit."""
        if self._seconds is None:
            return float("inf")
        if self.is_up():
            return 0.0
        speed = self.done / max(self.elapsed(), 1e-3) if self.done else self.first_speed
        return self.seconds_left() * speed
