"""What a run is planned for: this machine, its engine, and how fast they are."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import psutil

from pocketgs.splat.engine import Engine, MemoryNeed
from pocketgs.system.compile import is_compiled
from pocketgs.system.cores import kernel_threads, usable_cores
from pocketgs.training.options import SizedOptions
from pocketgs.training.planning.calibration import Speed


@dataclass(frozen=True)
class Machine:
    """What a run is planned for.

    Attributes:
        threads: that the CPU's work runs on.
        readers: threads that read photographs.
        resident: bytes of memory that the process holds.
        compiles: whether kernels are still to be compiled.
        memory_needed: what the engine takes, see `Engine.memory_needed`.
        speed: how fast it is; None where time is not bounded.
        elapsed: seconds since the command began.
    """

    threads: int
    readers: int
    resident: int
    compiles: bool
    memory_needed: Callable[[int, int, Sequence[tuple[int, int]]], MemoryNeed]
    speed: Speed | None = None
    elapsed: float = 0.0


def this_machine(engine: Engine, options: SizedOptions) -> Machine:
    """The machine that this process runs on, as fast as it may be."""
    rooms = ["splat.cpu"] if engine.name == "cpu" else []
    if options.prior != "none":
        rooms.append("prior")
    return Machine(
        threads=kernel_threads(options.threads),
        readers=usable_cores(),
        resident=psutil.Process().memory_info().rss,
        compiles=not all(map(is_compiled, rooms)),
        memory_needed=engine.memory_needed,
    )
