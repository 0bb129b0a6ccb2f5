"""Progress of a compression, and the reasons to end it early."""

from __future__ import annotations

import time
from collections.abc import Callable

from pocketgs.system.interrupt import Interrupt


class StoppedError(Exception):
    """Ctrl-C was pressed."""


class Course:
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

    def step(self) -> None:
        """A step has been done.

        Raises:
            StoppedError: Ctrl-C was pressed.
        """
        self.done += 1
        self._on_count(self.done, max(self.expected, self.done))
        self.check()

    def check(self) -> None:
        """See that the work should go on.

        Raises:
            StoppedError: Ctrl-C was pressed.
        """
        if self._interrupt.requested:
            raise StoppedError

    def used(self) -> float:
        """Share of the time that has passed, 0 without a limit."""
        return 0.0 if self._seconds is None else (time.monotonic() - self._began) / max(self._seconds, 1e-3)

    def steps_left(self) -> float:
        """How many steps fit into the rest of the time, at the speed so far; infinite without a limit."""
        if self._seconds is None or self.done == 0:
            return float("inf")
        elapsed = time.monotonic() - self._began
        return max(self._seconds - elapsed, 0.0) * self.done / max(elapsed, 1e-3)
