"""Timing of the passes of a training step."""

from __future__ import annotations

import time
from collections import defaultdict


class PassTimer:
    """Records the time of each pass: `engine.timer = PassTimer()`, and later `engine.timer.milliseconds`.

    Attributes:
        milliseconds: by pass, one number per execution.
    """

    def __init__(self) -> None:
        self.milliseconds: dict[str, list[float]] = defaultdict(list)
        self._under_way = ""
        self._began = 0.0

    def begins(self, name: str) -> None:
        """Start a pass, and end the previous one."""
        self.ends()
        self._under_way, self._began = name, time.perf_counter()

    def ends(self) -> None:
        """End the last pass."""
        if self._under_way:
            self.milliseconds[self._under_way].append(1e3 * (time.perf_counter() - self._began))
        self._under_way = ""


class NoTimer(PassTimer):
    """Records nothing."""

    def begins(self, name: str) -> None:
        """Does nothing."""

    def ends(self) -> None:
        """Does nothing."""
