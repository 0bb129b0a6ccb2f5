"""The machine that a run is planned for: its engine, memory and speed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from pocketgs.geometry.lens import COEFFICIENT_COUNTS
from pocketgs.prior.depth.room import need_of
from pocketgs.prior.depth.stereo import Stereo, StereoExtent, StereoNeed
from pocketgs.splat.engine import Engine
from pocketgs.system.compile import is_compiled
from pocketgs.system.compiled_variants import is_compiled_for
from pocketgs.system.cores import kernel_threads, usable_cores
from pocketgs.system.device import MemoryNeed
from pocketgs.system.process import resident_bytes
from pocketgs.training.options import SizedOptions
from pocketgs.training.planning.calibration import Speed, times_prior

ENGINE_KERNELS, FEATURE_KERNELS, SWEEP_KERNELS = "splat.cpu", "prior.features.cpu", "prior.depth.cpu"
"""Packages with kernels that only the CPU runs: the engine, the finder of features, the plane sweep."""

PRIOR_KERNELS = ("prior.poses", "prior.bundle", "prior.cloud")
"""Packages with kernels that every prior runs."""


@dataclass(frozen=True)
class Machine:
    """The machine that a run is planned for.

    Attributes:
        threads: CPU threads.
        cores: that read photographs.
        resident: resident memory of the process in bytes.
        compiles: whether kernels must still be compiled, whatever the size of the run.
        compiles_sweeps: whether the CPU's sweeps must still be compiled, if it sweeps.
        compiles_lenses: models of lenses for which the engine must still be compiled, if photographs keep theirs.
        memory_needed: the engine's memory, see `Engine.memory_needed`.
        stereo_needed: the memory of depth, see `Stereo.memory_needed`.
        speed: relative speed; None if time is not bounded.
        elapsed: seconds since the command began.
    """

    threads: int
    cores: int
    resident: int
    compiles: bool
    memory_needed: Callable[[int, int, Sequence[tuple[int, int]]], MemoryNeed]
    stereo_needed: Callable[[StereoExtent], StereoNeed]
    compiles_sweeps: bool = False
    compiles_lenses: frozenset[str] = frozenset()
    speed: Speed | None = None
    elapsed: float = 0.0


def this_machine(engine: Engine, stereo: Stereo, options: SizedOptions) -> Machine:
    """Describe this machine; its speed is measured only if time is bounded."""
    packages = [ENGINE_KERNELS] if engine.name == "cpu" else []
    if options.prior != "none":
        packages += [*PRIOR_KERNELS, FEATURE_KERNELS] if stereo.name == "cpu" else PRIOR_KERNELS
    if options.time_budget is not None and times_prior(engine, options):
        packages.append(SWEEP_KERNELS)
    return Machine(
        threads=kernel_threads(options.threads),
        cores=usable_cores(),
        resident=resident_bytes(),
        compiles=not all(map(is_compiled, packages)),
        memory_needed=engine.memory_needed,
        stereo_needed=lambda extent: need_of(stereo, extent),
        compiles_sweeps=not is_compiled(SWEEP_KERNELS),
        compiles_lenses=frozenset(
            model for model in COEFFICIENT_COUNTS if engine.name == "cpu" and not is_compiled_for(ENGINE_KERNELS, model)
        ),
    )
