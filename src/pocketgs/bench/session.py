"""Running the cells of a table that are still to be run."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import mean

from pocketgs.bench.captures import BenchCapture
from pocketgs.bench.cell import Job, run_cell
from pocketgs.bench.methods import Method
from pocketgs.bench.results import Cell, CellResult, read_results, write_result
from pocketgs.capture.synthetic import true_capture
from pocketgs.summary import versions
from pocketgs.training import train
from pocketgs.training_options import TrainingOptions

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
    methods: Sequence[Method], captures: Sequence[BenchCapture], seeds: Iterable[int], common_flags: tuple[str, ...]
) -> list[Job]:
    """All cells of a table, the first seed of everything before the second: what is there early covers the table."""
    return [Job(method, capture, seed, common_flags) for seed in seeds for capture in captures for method in methods]


def remaining(jobs: Sequence[Job], results: Sequence[CellResult]) -> list[Job]:
    """The jobs without a result of the same command and the same version of this package; failures are tried again."""
    version = versions()["pocketgs"]
    done = {
        (result.cell, result.command)
        for result in results
        if result.error is None and result.run.get("versions", {}).get("pocketgs") == version
    }
    return [job for job in jobs if (job.cell, job.command) not in done]


def run_jobs(
    jobs: Sequence[Job],
    folder: Path,
    work: Path,
    on_step: Callable[[Step], None],
    on_result: Callable[[CellResult], None],
) -> None:
    """Run jobs one after the other and keep each result as it comes.

    Args:
        jobs: what to run.
        folder: for the results.
        work: for what the runs write.
        on_step: called before each.
        on_result: called after each, whether it failed or not.

    Raises:
        PocketGSError: a result cannot be written.
        KeyboardInterrupt: Ctrl-C; the results so far are kept.
    """
    for number, job in enumerate(jobs, start=1):
        left = seconds_left(jobs[number - 1 :], read_results(folder))
        on_step(Step(job.cell, number, len(jobs), left))
        result = run_cell(job, work)
        write_result(folder, result)
        on_result(result)


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
    """Compile what the CPU's kernels need, by training on a tiny capture: no cell's time should include it."""
    capture = true_capture(width=96, height=72, frames=8, points=2000)
    train(capture, TrainingOptions(iterations=1, engine="cpu", max_gaussians=500, evaluate_every=0))
