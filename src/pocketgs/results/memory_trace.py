"""Memory use of the process over time."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from types import TracebackType

from pocketgs.system.process import resident_bytes, seconds_since_start

MAX_SAMPLES = 400
"""Maximum number of samples; when it is reached, every other one is dropped and the interval doubles."""


@dataclass(frozen=True)
class MemorySample:
    """Resident memory, in MB of 10^6 bytes, and the stage at one moment; `seconds` since the process began."""

    seconds: float
    stage: str
    rss_mb: float


class MemoryTrace:
    """Samples this process's resident memory in a thread while the `with` block runs.

    Args:
        stage: returns the name of the current stage.
        interval: seconds between samples at first; doubled whenever there are too many samples.
    """

    def __init__(self, stage: Callable[[], str], interval: float = 0.2) -> None:
        self.samples: list[MemorySample] = []
        self._stage, self._interval = stage, interval
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="memory trace", daemon=True)

    def __enter__(self) -> MemoryTrace:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._over.set()
        self._thread.join()

    def _watch(self) -> None:
        while True:
            rss_mb = resident_bytes() / 1e6
            self.samples.append(MemorySample(round(seconds_since_start(), 2), self._stage(), round(rss_mb, 1)))
            if len(self.samples) > MAX_SAMPLES:
                self.samples, self._interval = self.samples[::2], 2 * self._interval
            if self._over.wait(self._interval):
                return
