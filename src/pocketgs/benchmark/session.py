"""Running the remaining cells of a table."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import mean

from pocketgs.benchmark.captures import BenchCapture
from pocketgs.benchmark.cell import Job, run_cell
from pocketgs.benchmark.conditions import Conditions
from pocketgs.benchmark.methods import METHODS, Method
from pocketgs.benchmark.results import Cell, CellResult, read_results, write_result
from pocketgs.capture.synthetic import demo_capture
from pocketgs.errors import PocketGSError
from pocketgs.training.options import TrainingOptions
from pocketgs.training.train import train

OVERHEAD = 1.5
"""Factor from a cell's own seconds to its total time, with evaluations, start-up and measurements."""


@dataclass(frozen=True)
class Step:
    """Progress before a cell runs.

    Attributes:
        cell: the next one.
        number, count: its position among the remaining cells, from 1.
        seconds_left: estimate for it and all following cells, or None if nothing similar has run yet.
    """

    cell: Cell
    number: int
    count: int
    seconds_left: float | None


def plan_jobs(
    methods: Sequence[Method], captures: Sequence[BenchCapture], seeds: Sequence[int], common_flags: tuple[str, ...]
) -> list[Job]:
    """All cells of a table, ordered by seed, so that early results cover the whole table.

    Raises:
        PocketGSError: a seed is named twice, or is negative.
    """
    for seed in seeds:
        if seed < 0:
            raise PocketGSError(f"seed: found {seed}, expected at least 0")
        if seeds.count(seed) > 1:
            raise PocketGSError(f"seed {seed}: named twice, expected each once")
    return [Job(method, capture, seed, common_flags) for seed in seeds for capture in captures for method in methods]


def remaining(jobs: Sequence[Job], results: Sequence[CellResult], conditions: Conditions) -> list[Job]:
    """The jobs without a result of the same command, capture and conditions; failed ones are retried."""
    done = {
        (result.cell, result.command, result.files)
        for result in results
        if result.error is None and result.conditions == conditions
    }
    return [job for job in jobs if (job.cell, job.command, job.capture.files) not in done]


def comparable(results: Sequence[CellResult], jobs: Sequence[Job], conditions: Conditions) -> list[CellResult]:
    """The results that can be compared with those of the jobs.

    Args:
        results: of cells of any table.
        jobs: of the table.
        conditions: of the jobs.

    Returns:
        Those with the same conditions; for the jobs' captures, only those that read the same files in the same way, and
        of other captures only those of which all results read the same files in one way.
    """
    alike = [result for result in results if result.conditions == conditions and result.cell.method in METHODS]
    readings: dict[str, set[tuple[str, str]]] = {}
    for result in alike:
        readings.setdefault(result.cell.capture, set()).add((_reading(result), result.files))
    asked = {job.capture.name: job for job in jobs}

    def fits(result: CellResult) -> bool:
        cell = result.cell
        job = asked.get(cell.capture)
        if job is None:
            return len(readings[cell.capture]) == 1
        expected = replace(job, method=METHODS[cell.method], seed=cell.seed)
        return (result.command, result.files) == (expected.command, expected.capture.files)

    return list(filter(fits, alike))


def _reading(result: CellResult) -> str:
    """The beginning of a result's command: how it read the capture."""
    method = shlex.join(METHODS[result.cell.method].flags)
    rest = (method, result.settings, f"--seed {result.cell.seed}")
    return result.command.removesuffix(" ".join(filter(None, rest)))


def run_jobs(
    jobs: Sequence[Job],
    folder: Path,
    work: Path,
    on_step: Callable[[Step], None],
    on_result: Callable[[CellResult], None],
) -> list[CellResult]:
    """Run jobs one after the other, and save each result.

    Earlier successes stay where a result does not repeat them, see `write_result`.

    Args:
        jobs: to run.
        folder: for the results.
        work: for the runs' files.
        on_step: called before each.
        on_result: called after each, also if it failed.

    Returns:
        The result of each.

    Raises:
        PocketGSError: a result cannot be read or written.
        KeyboardInterrupt: Ctrl-C; the results so far are kept.
    """
    found = []
    for number, job in enumerate(jobs, start=1):
        left = seconds_left(jobs[number - 1 :], read_results(folder))
        on_step(Step(job.cell, number, len(jobs), left))
        result = run_cell(job, work)
        found.append(result)
        write_result(folder, result)
        on_result(result)
    return found


def seconds_left(jobs: Sequence[Job], results: Sequence[CellResult]) -> float | None:
    """Estimated time of some jobs, from results of the same cell, capture, or any; None without results."""
    done = [result for result in results if result.error is None]
    if not done:
        return None

    def seconds(job: Job) -> float:
        alike = [
            result
            for result in done
            if (result.cell.capture, result.cell.method) == (job.cell.capture, job.cell.method)
        ]
        near = [result for result in done if result.cell.capture == job.cell.capture]
        return mean(result.wall_seconds for result in alike or near or done)

    return OVERHEAD * sum(seconds(job) for job in jobs)


def compile_kernels() -> None:
    """Compile the CPU kernels by training on a small capture, so that no cell's time includes compilation.

    Its poses are a phone's, so that the kernels of pose refinement are compiled too.
    """
    capture = demo_capture(width=160, height=120, frames=20)
    train(capture, TrainingOptions(iterations=1, engine="cpu", max_gaussians=500, evaluate_every=0))
