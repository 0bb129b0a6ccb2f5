"""Running the cells of a table that are still to be run."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import mean

from pocketgs.bench.captures import BenchCapture
from pocketgs.bench.cell import Job, run_cell
from pocketgs.bench.conditions import Conditions
from pocketgs.bench.methods import METHODS, Method
from pocketgs.bench.results import Cell, CellResult, read_results, write_result
from pocketgs.capture.synthetic import demo_capture
from pocketgs.errors import PocketGSError
from pocketgs.training.loop import train
from pocketgs.training.options import TrainingOptions

OVERHEAD = 1.5
"""A cell takes about this many times its own seconds: looks at held-out views, starting, and measuring come on top."""


@dataclass(frozen=True)
class Step:
    """What is told before a cell is run.

    Attributes:
        cell: that comes next.
        number, count: its place among those still to be run, from 1.
        seconds_left: estimate for it and all after it, or None before anything like it has been run.
    """

    cell: Cell
    number: int
    count: int
    seconds_left: float | None


def plan_jobs(
    methods: Sequence[Method], captures: Sequence[BenchCapture], seeds: Sequence[int], common_flags: tuple[str, ...]
) -> list[Job]:
    """All cells of a table, the first seed of everything before the second: what is there early covers the table.

    Raises:
        PocketGSError: a seed is named twice.
    """
    for seed in seeds:
        if seeds.count(seed) > 1:
            raise PocketGSError(f"seed {seed}: named twice, expected each once")
    return [Job(method, capture, seed, common_flags) for seed in seeds for capture in captures for method in methods]


def remaining(jobs: Sequence[Job], results: Sequence[CellResult], conditions: Conditions) -> list[Job]:
    """The jobs without a result of the same command under these conditions; those that failed are tried again."""
    done = {
        (result.cell, result.command) for result in results if result.error is None and result.conditions == conditions
    }
    return [job for job in jobs if (job.cell, job.command) not in done]


def comparable(results: Sequence[CellResult], jobs: Sequence[Job], conditions: Conditions) -> list[CellResult]:
    """The results that can stand in one table with those of the jobs.

    Args:
        results: of cells of any table.
        jobs: that the table is made for.
        conditions: of the jobs.

    Returns:
        Those under the same conditions; of the jobs' captures only those that read them in the same way.
    """
    asked = {job.capture.name: job for job in jobs}

    def fits(result: CellResult) -> bool:
        cell = result.cell
        if result.conditions != conditions or cell.method not in METHODS:
            return False
        job = asked.get(cell.capture)
        return job is None or result.command == replace(job, method=METHODS[cell.method], seed=cell.seed).command

    return list(filter(fits, results))


def run_jobs(
    jobs: Sequence[Job],
    folder: Path,
    work: Path,
    on_step: Callable[[Step], None],
    on_result: Callable[[CellResult], None],
) -> list[CellResult]:
    """Run jobs one after the other and keep each result as it comes.

    A cell that fails leaves an earlier success of the same command under the same conditions in its place.

    Args:
        jobs: what to run.
        folder: for the results.
        work: for what the runs write.
        on_step: called before each.
        on_result: called after each, whether it failed or not.

    Returns:
        What came of each.

    Raises:
        PocketGSError: a result cannot be read or written.
        KeyboardInterrupt: Ctrl-C; the results so far are kept.
    """
    found = []
    kept = {result.cell: result for result in read_results(folder)}
    for number, job in enumerate(jobs, start=1):
        left = seconds_left(jobs[number - 1 :], list(kept.values()))
        on_step(Step(job.cell, number, len(jobs), left))
        result = run_cell(job, work)
        found.append(result)
        earlier = kept.get(job.cell)
        if result.error is None or earlier is None or earlier.error is not None or not result.repeats(earlier):
            write_result(folder, result)
            kept[job.cell] = result
        on_result(result)
    return found


def seconds_left(jobs: Sequence[Job], results: Sequence[CellResult]) -> float | None:
    """Estimate of the time that jobs take, from results of the same cell, capture or any; None without results."""
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
    """Compile the CPU's kernels by training on a small capture: no cell's time should include it.

    Its poses are a phone's, so that the kernels which refine poses are compiled too.
    """
    capture = demo_capture(width=160, height=120, frames=20)
    train(capture, TrainingOptions(iterations=1, engine="cpu", max_gaussians=500, evaluate_every=0))
