"""What a run took: wall time by stage, memory, and how loss and quality went."""

from __future__ import annotations

import re
import sys
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import psutil

from pocketgs.prior.report import PriorReport
from pocketgs.splat.engine import OptimiserState


class Stopwatch:
    """Adds up wall time by stage.

    Args:
        on_stage: called with a stage's name when it begins.
    """

    def __init__(self, on_stage: Callable[[str], None] | None = None) -> None:
        self.seconds: dict[str, float] = defaultdict(float)
        self.current = "startup"
        """The stage under way, or the last one."""
        self._on_stage = on_stage

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Add the time that the block takes to a stage."""
        self.current = name
        if self._on_stage:
            self._on_stage(name)
        started = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[name] += time.perf_counter() - started


@dataclass(frozen=True)
class LossSample:
    """Loss and held-out PSNR at one moment of training.

    Attributes:
        iteration: steps done.
        seconds: of training so far.
        elapsed: seconds of all stages so far, looking at held-out views left out: when a run that never looks would
            have come as far.
        loss: of training.
        held_out_psnr: in dB.
    """

    iteration: int
    seconds: float
    elapsed: float
    loss: float
    held_out_psnr: float


@dataclass(frozen=True)
class RunRecord:
    """What training took.

    Attributes:
        engine, recipe: their names.
        device: what the engine computed on.
        iterations: iterations done, those before a resumption included.
        resumed_from: iterations that an earlier run had done, or None; `seconds` and `losses` are of this run only.
        interrupted: whether Ctrl-C ended it.
        gaussians: number of Gaussians.
        seconds: wall time by stage.
        peak_rss_mb: most memory that the process held, in MB of 10^6 bytes.
        engine_bytes: what the engine held, by name.
        losses: samples over the run.
        optimiser_state: for going on later.
        prior: what the geometry prior found, or None if there was none.
    """

    engine: str
    device: str
    recipe: str
    iterations: int
    resumed_from: int | None
    interrupted: bool
    gaussians: int
    seconds: dict[str, float]
    peak_rss_mb: float
    engine_bytes: dict[str, int]
    losses: list[LossSample]
    optimiser_state: OptimiserState
    prior: PriorReport | None = None


def peak_rss_mb() -> float:
    """Most resident memory that this process has held so far, in MB of 10^6 bytes."""
    # On Linux, what getrusage reports begins with the peak of the program that started this one.
    high_water = re.search(r"VmHWM:\s*(\d+) kB", _process_status())
    if high_water:
        return int(high_water[1]) * 1024 / 1e6
    if sys.platform == "win32":
        return float(psutil.Process().memory_info().peak_wset) / 1e6
    import resource

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / 1e6 if sys.platform == "darwin" else peak * 1024 / 1e6


def _process_status() -> str:
    """What Linux tells of this process; empty where it does not, as in some sandboxes and on other systems."""
    try:
        return Path("/proc/self/status").read_text(encoding="ascii", errors="replace")
    except OSError:
        return ""


def seconds_since_start() -> float:
    """Wall time since this process was started."""
    return time.time() - float(psutil.Process().create_time())
