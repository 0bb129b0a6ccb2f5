"""The plan of a run: the largest size that budgets of memory and time allow, or a refusal that says what would do.

Sizes are tried in one order, and the first that fits is taken: photographs at their size, then at a half, a third and
so on, each with as many Gaussians as are asked for, a half and a quarter of them; at the last size ever fewer. Where
time is short, fewer iterations come first: a size has time enough if it leaves half of those that are asked for. So a
larger budget never gives smaller photographs, nor fewer Gaussians at the same size.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

from pocketgs.capture.listed import ListedCapture, Outline
from pocketgs.errors import PocketGSError
from pocketgs.training.options import SizedOptions
from pocketgs.training.planning.machine import Machine
from pocketgs.training.planning.memory_model import MB, stage_bytes
from pocketgs.training.planning.time_model import Timetable, timetable
from pocketgs.training.planning.work import Work

MIN_SIDE = 100
"""Photographs are not shrunk until their shorter side has fewer pixels."""

MIN_GAUSSIANS = 1000
"""Fewer show nothing, unless fewer are asked for."""

SHRINKING = (1, 2, 4)
"""Parts of the Gaussians that are asked for, which are tried before photographs shrink."""

ENOUGH_ITERATIONS, MIN_ITERATIONS = 0.5, 50
"""Share of the iterations that are asked for which a size must leave time for; how many the last size must."""


@dataclass(frozen=True)
class Plan:
    """The size of a run, and what it is expected to take.

    Attributes:
        shrink: whole factor by which photographs are smaller than asked for.
        width, height: of the largest photograph.
        gaussians: most to start with.
        peak_rss_mb: most memory of the process, in MB of 10^6 bytes.
        rss_by_stage_mb: the same by stage.
        device_mb: buffers on the GPU.
        iterations: that there is time for.
        seconds: of the whole run, or None where time is not bounded, and thus not estimated.
        reserve: seconds from the last iteration until the result is written, or None.
    """

    shrink: int
    width: int
    height: int
    gaussians: int
    peak_rss_mb: float
    rss_by_stage_mb: dict[str, float]
    device_mb: float
    iterations: int
    seconds: float | None = None
    reserve: float | None = None


@dataclass(frozen=True)
class _Size:
    """A size that is tried, and what it would take; `refusal` where the engine's memory does not hold it."""

    shrink: int
    work: Work
    rss: dict[str, int]
    device: int
    times: Timetable | None
    refusal: PocketGSError | None = None

    @property
    def peak(self) -> int:
        return max(self.rss.values())


def make_plan(listed: ListedCapture, options: SizedOptions, machine: Machine) -> Plan:
    """Choose the size of a run.

    Args:
        listed: the capture; nothing of it is decoded.
        options: of the run, with its budgets.
        machine: what it is to run on.

    Raises:
        PocketGSError: no size fits; the message says which budget would be enough for the smallest.
    """
    last: _Size | None = None
    for shrink, outline, gaussians in _sizes_to_try(listed, options.max_gaussians):
        last = _size(shrink, outline, replace(options, max_gaussians=gaussians), machine)
        if _fits(last, options) and _steps(last, options, machine) >= ENOUGH_ITERATIONS * options.iterations:
            return _plan(last, options, machine)
    assert last is not None
    if last.refusal:
        raise last.refusal
    if not _fits(last, options):
        raise PocketGSError(_too_little_memory(last, listed, options, machine))
    if _steps(last, options, machine) < min(MIN_ITERATIONS, options.iterations):
        raise PocketGSError(_too_little_time(last, listed, options, machine))
    return _plan(last, options, machine)


def plan_again(listed: ListedCapture, options: SizedOptions, machine: Machine, shrink: int, gaussians: int) -> Plan:
    """The plan of a run that goes on: of the size that it has.

    Args:
        listed: the capture.
        options: of the run.
        machine: what it is to run on.
        shrink: as in the plan of the run that goes on.
        gaussians: that it has.

    Raises:
        PocketGSError: memory does not hold it.
    """
    size = _size(shrink, listed.outline(shrink), replace(options, max_gaussians=gaussians), machine)
    if size.refusal:
        raise size.refusal
    if not _fits(size, options):
        raise PocketGSError(_too_little_memory(size, listed, options, machine))
    return _plan(size, options, machine)


def shrinking_warning(plan: Plan, options: SizedOptions) -> str | None:
    """What the user should know of a plan for less than was asked for, or None."""
    parts = []
    if plan.shrink > 1:
        size = f"{plan.width}x{plan.height} (--downscale {plan.shrink})"
        parts.append(f"photographs at 1/{plan.shrink} of their size, {size}")
    if plan.gaussians < options.max_gaussians:
        parts.append(f"at most {plan.gaussians:,} Gaussians")
    if not parts:
        return None
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
    times = timetable(work, machine.speed) if machine.speed else None
    try:
        engine = machine.memory_needed(work.gaussians, work.coefficients, outline.training)
    except PocketGSError as error:
        return _Size(shrink, work, {"training": 0}, 0, times, error)
    return _Size(
        shrink,
        work,
        stage_bytes(work, engine, machine.resident, machine.compiles, machine.readers),
        engine.device,
        times,
    )


def _fits(size: _Size, options: SizedOptions) -> bool:
    return size.refusal is None and max(size.peak, size.device) <= options.max_memory * MB


def _steps(size: _Size, options: SizedOptions, machine: Machine) -> int:
    """Iterations that there is time for, at most those that are asked for."""
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
        peak_rss_mb=size.peak / MB,
        rss_by_stage_mb={stage: rss / MB for stage, rss in size.rss.items()},
        device_mb=size.device / MB,
        iterations=steps,
        seconds=machine.elapsed + size.times.total(steps) if size.times else None,
        reserve=size.times.after if size.times else None,
    )


def _too_little_memory(size: _Size, listed: ListedCapture, options: SizedOptions, machine: Machine) -> str:
    needed = -(-max(size.peak, size.device) // (10 * MB)) * 10
    stage = max(size.rss, key=lambda name: size.rss[name])
    first = ", since kernels are compiled in the first run," if machine.compiles else ""
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
