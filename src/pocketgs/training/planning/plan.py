"""The plan of a run: the largest size that budgets of memory and time allow, or an error with the budget needed.

Sizes are tried in order, and the first that fits is used: photographs at full size, then at a half, a third and so on,
each with the requested number of Gaussians, a half and a quarter of it; at the last size ever fewer. If time is short,
iterations are reduced first: a size fits if it leaves time for half of those requested. With a budget of time, a number
of iterations above the run's default counts as the default: a huge number means "as many as fit". So neither a larger
budget nor more iterations than that give smaller photographs, nor fewer Gaussians at the same size.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

from pocketgs.capture.listed import ListedCapture
from pocketgs.capture.outline import Outline
from pocketgs.errors import PocketGSError
from pocketgs.prior.depth.stereo import StereoNeed
from pocketgs.system.device import MB, MemoryNeed
from pocketgs.training.options import SizedOptions
from pocketgs.training.planning.calibration import Speed
from pocketgs.training.planning.machine import Machine
from pocketgs.training.planning.memory_model import readers_that_fit, stage_bytes
from pocketgs.training.planning.time_model import Timetable, timetable
from pocketgs.training.planning.work import Work

MIN_SIDE = 100
"""Minimum length of a photograph's shorter side, in pixels, when shrinking."""

MIN_GAUSSIANS = 1000
"""Minimum number of Gaussians, unless fewer are requested."""

SHRINKING = (1, 2, 4)
"""Divisors of the requested number of Gaussians, tried before photographs shrink."""

ENOUGH_ITERATIONS, MIN_ITERATIONS = 0.5, 50
"""Share of the requested iterations that a size must leave time for; and the minimum number at the last size."""

LONG_RUN = 3000
"""Maximum number of iterations that counts as requested: recipes set more, or train until it stops paying."""


@dataclass(frozen=True)
class Plan:
    """The size of a run, and the resources that it is expected to take.

    Attributes:
        shrink: integer factor by which photographs are reduced further than requested.
        width, height: of the largest photograph.
        gaussians: maximum number of the run.
        readers: number of photographs to read at the same time.
        peak_rss_mb: peak memory of the process, in MB of 10^6 bytes.
        rss_by_stage_mb: the same by stage.
        device_mb: buffers on the GPU.
        iterations: number of iterations that fit into the time.
        seconds: of the whole run, or None if time is not bounded, and so not estimated.
        reserve: seconds from the last iteration until the result is written, or None.
    """

    shrink: int
    width: int
    height: int
    gaussians: int
    readers: int
    peak_rss_mb: float
    rss_by_stage_mb: dict[str, float]
    device_mb: float
    iterations: int
    seconds: float | None = None
    reserve: float | None = None


@dataclass(frozen=True)
class _Size:
    """A candidate size with its requirements, and whether it compiles; `refusal` if the engine cannot hold it."""

    shrink: int
    work: Work
    readers: int
    rss: dict[str, int]
    device: int
    times: Timetable | None
    compiles: bool
    refusal: PocketGSError | None = None

    @property
    def peak(self) -> int:
        return max(self.rss.values())


def make_plan(listed: ListedCapture, options: SizedOptions, machine: Machine) -> Plan:
    """Choose the size of a run.

    Args:
        listed: the capture, not decoded.
        options: of the run, with its budgets.
        machine: to run on.

    Raises:
        PocketGSError: no size fits; the message says which budget would be enough for the smallest.
    """
    last: _Size | None = None
    for shrink, outline, gaussians in _sizes_to_try(listed, options.max_gaussians):
        last = _size(shrink, outline, replace(options, max_gaussians=gaussians), machine)
        if _fits(last, options) and _steps(last, options, machine) >= _enough(options):
            return _plan(last, options, machine)
    assert last is not None
    if last.refusal:
        raise last.refusal
    if not _fits(last, options):
        raise PocketGSError(_too_little_memory(last, listed, options))
    if _steps(last, options, machine) < min(MIN_ITERATIONS, options.iterations):
        raise PocketGSError(_too_little_time(last, listed, options, machine))
    return _plan(last, options, machine)


def plan_again(listed: ListedCapture, options: SizedOptions, machine: Machine, shrink: int, gaussians: int) -> Plan:
    """The plan of a resumed run, with the size of the original.

    Args:
        listed: the capture.
        options: of the run.
        machine: to run on.
        shrink: of the original run's plan.
        gaussians: maximum number of the original run.

    Raises:
        PocketGSError: it exceeds the memory budget.
    """
    size = _size(shrink, listed.outline(shrink), replace(options, max_gaussians=gaussians), machine)
    if size.refusal:
        raise size.refusal
    if not _fits(size, options):
        raise PocketGSError(_too_little_memory(size, listed, options))
    return _plan(size, options, machine)


def shrinking_warning(plan: Plan, options: SizedOptions) -> str | None:
    """A warning if the plan is smaller than requested, or None."""
    parts = []
    if plan.shrink > 1:
        size = f"{plan.width}x{plan.height} (--downscale {plan.shrink})"
        parts.append(f"photographs at 1/{plan.shrink} of their size, {size}")
    if plan.gaussians < options.max_gaussians:
        parts.append(f"at most {plan.gaussians:,} Gaussians")
    if not parts:
        return None
    if plan.iterations < options.iterations:
        requested = "" if options.open_ended else f" of {options.iterations:,}"
        parts.append(f"about {plan.iterations:,}{requested} iterations")
    seconds = "" if options.time_budget is None else f" and {options.time_budget:g} s"
    return f"to keep to {options.max_memory:,} MB{seconds}: {', '.join(parts)}"


def _sizes_to_try(listed: ListedCapture, gaussians: int) -> Iterator[tuple[int, Outline, int]]:
    least = min(MIN_GAUSSIANS, gaussians)
    outline = listed.outline()
    most = 1 if listed.size_is_given else max(1, outline.least_side // MIN_SIDE)
    for shrink in range(1, most + 1):
        outline = listed.outline(shrink)
        for part in SHRINKING:
            yield shrink, outline, max(least, gaussians // part)
    fewer = gaussians // SHRINKING[-1]
    while fewer > least:
        fewer = max(least, fewer // 2)
        yield most, outline, fewer


def _size(shrink: int, outline: Outline, options: SizedOptions, machine: Machine) -> _Size:
    work = Work(outline, options, machine.threads)
    stereo = machine.stereo_needed(work.stereo_extent) if work.has_depth else StereoNeed(MemoryNeed(0), MemoryNeed(0))
    times = timetable(work, _speed_with(stereo, machine.speed)) if machine.speed else None
    compiles = machine.compiles or (machine.compiles_sweeps and work.has_depth and not stereo.on_gpu)
    compiles |= not outline.kept_lenses.isdisjoint(machine.compiles_lenses)
    try:
        engine = machine.memory_needed(work.gaussians, work.coefficients, outline.training)
    except PocketGSError as error:
        return _Size(shrink, work, 1, {"training": 0}, 0, times, compiles, error)
    readers = readers_that_fit(work, machine.resident, compiles, machine.cores)
    return _Size(
        shrink,
        work,
        readers,
        stage_bytes(work, engine, stereo, machine.resident, compiles, readers),
        # Each gives its buffers back before the next makes its own. Seeding's never take as much as the engine's.
        max(engine.device, stereo.sweeping.device, stereo.comparing.device),
        times,
        compiles,
    )


def _speed_with(stereo: StereoNeed, speed: Speed) -> Speed:
    """The speed with the CPU's for sweeps that the GPU has too little memory for."""
    return speed if stereo.on_gpu else replace(speed, sweeps=speed.prior)


def _fits(size: _Size, options: SizedOptions) -> bool:
    return size.refusal is None and max(size.peak, size.device) <= options.max_memory * MB


def _enough(options: SizedOptions) -> float:
    """Iterations that a size must leave time for, if there is a smaller one."""
    return ENOUGH_ITERATIONS * min(options.iterations, options.usual_iterations, LONG_RUN)


def _steps(size: _Size, options: SizedOptions, machine: Machine) -> int:
    """Iterations that there is time for, at most those requested."""
    if size.times is None or options.time_budget is None:
        return options.iterations
    return min(options.iterations, size.times.steps_within(options.time_budget - machine.elapsed))


def _plan(size: _Size, options: SizedOptions, machine: Machine) -> Plan:
    steps = _steps(size, options, machine)
    width, height = size.work.outline.largest
    return Plan(
        shrink=size.shrink,
        width=width,
        height=height,
        gaussians=size.work.gaussians,
        readers=size.readers,
        peak_rss_mb=size.peak / MB,
        rss_by_stage_mb={stage: rss / MB for stage, rss in size.rss.items()},
        device_mb=size.device / MB,
        iterations=steps,
        seconds=machine.elapsed + size.times.total(steps) if size.times else None,
        reserve=size.times.after if size.times else None,
    )


def _too_little_memory(size: _Size, listed: ListedCapture, options: SizedOptions) -> str:
    needed = -(-max(size.peak, size.device) // (10 * MB)) * 10
    stage = max(size.rss, key=lambda name: size.rss[name])
    first = ", since kernels are compiled in the first run," if size.compiles else ""
    return (
        f"max memory: found {options.max_memory:,} MB, but {_described(size, listed)}{first} up to {needed:,} MB are "
        f"held (stage {stage}): expected --max-memory {needed} or more{_instead(listed)}"
    )


def _too_little_time(size: _Size, listed: ListedCapture, options: SizedOptions, machine: Machine) -> str:
    assert size.times is not None
    iterations = min(MIN_ITERATIONS, options.iterations)
    needed = int(machine.elapsed + size.times.total(iterations)) + 1
    return (
        f"time budget: found {options.time_budget:g} s, but {_described(size, listed)}, {iterations} iterations take "
        f"about {needed} s here: expected --time-budget {needed} or more{_instead(listed)}"
    )


def _described(size: _Size, listed: ListedCapture) -> str:
    width, height = size.work.outline.largest
    which = "with" if listed.size_is_given else "even with"
    return f"{which} photographs of {width}x{height} and {size.work.gaussians:,} Gaussians"


def _instead(listed: ListedCapture) -> str:
    return ", or a larger --downscale" if listed.size_is_given else ""
