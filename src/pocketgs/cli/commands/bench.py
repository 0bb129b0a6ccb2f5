"""`pocketgs bench`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import tyro
from rich import box
from rich.table import Table
from rich.text import Text

from pocketgs.benchmark.captures import DEMO, BenchCapture, captures_named, data_folder, known_captures
from pocketgs.benchmark.cell import Job
from pocketgs.benchmark.conditions import Conditions, present_conditions
from pocketgs.benchmark.methods import METHODS, methods_named
from pocketgs.benchmark.plots import write_overview
from pocketgs.benchmark.report import check_report_possible, write_report
from pocketgs.benchmark.results import CellResult, read_results
from pocketgs.benchmark.session import Step, comparable, compile_kernels, plan_jobs, remaining, run_jobs
from pocketgs.benchmark.table import markdown_table
from pocketgs.capture.options import CaptureOptions
from pocketgs.capture.synthetic import write_demo
from pocketgs.cli.flags import flags_of
from pocketgs.cli.output_file import make_writable
from pocketgs.cli.terminal import Terminal, printable
from pocketgs.errors import PocketGSError
from pocketgs.files.atomic_file import replacing
from pocketgs.splat.engine import EngineName
from pocketgs.training.options import Effort, TrainingOptions

TABLE, OVERVIEW, REPORT = "results.md", "overview.png", "report.html"


@dataclass(frozen=True)
class Everywhere:
    """Options common to all cells.

    Attributes:
        effort: Preset of the cells' sizes, see `pocketgs train`.
        iterations: Training steps of every cell.
        evaluate_every: Iterations between evaluations on the held-out views.
        engine: Rendering and training engine.
    """

    effort: Effort = "quick"
    iterations: int = 500
    evaluate_every: int = 50
    engine: EngineName = "auto"

    def __post_init__(self) -> None:
        # Refuses what would fail in every cell.
        TrainingOptions(
            effort=self.effort, iterations=self.iterations, evaluate_every=self.evaluate_every, engine=self.engine
        )

    @property
    def flags(self) -> tuple[str, ...]:
        """The options as flags of `pocketgs train`."""
        return (
            *("--effort", self.effort),
            *("--iterations", str(self.iterations)),
            *("--evaluate-every", str(self.evaluate_every)),
            *("--engine", self.engine),
        )


def bench(
    captures: tuple[str, ...] = (),
    methods: tuple[str, ...] = (),
    seeds: tuple[int, ...] = (0,),
    show: Annotated[bool, tyro.conf.arg(name="list")] = False,
    again: bool = False,
    data: Path | None = None,
    demo: Path = Path("output/demo-capture"),
    output: Path = Path("bench/results"),
    work: Path = Path("output/bench"),
    everywhere: Everywhere = Everywhere(),
    reading: CaptureOptions = CaptureOptions(),  # noqa: B008
) -> None:
    """Compare methods on captures: run the cells without a result, and write tables and a report.

    Each cell of the table is a `pocketgs train` command in a process of its own. Results are stored one by one, so an
    interrupted table continues where it stopped.

    Args:
        captures: Names of known captures, or folders of your own; by default all known ones that are present.
        methods: By default all.
        seeds: Random seeds; several show how much results vary.
        show: List methods and captures, what is missing and where to get it, and run nothing.
        again: Also rerun cells that have a result.
        data: Folder of the known captures; by default the one that POCKETGS_DATA names, or data.
        demo: Folder of the built-in demo's capture.
        output: Folder for the results, the table (results.md), its chart (overview.png) and the report (report.html).
        work: Folder for the runs' output.
        everywhere: Options of all cells.
        reading: How to read captures of your own; not allowed with known ones only, which are read as published results
            read them.
    """
    console = Terminal()
    known = known_captures(data_folder(data), demo)
    if show:
        _print_list(console, known)
        return
    check_report_possible()
    _check_output(output)
    named = captures_named(captures, known, flags_of(reading))
    chosen = [replace(capture, written=(output, work, demo)) for capture in named]
    jobs = plan_jobs(methods_named(methods), chosen, seeds, everywhere.flags)
    conditions = present_conditions(everywhere.flags)
    left = jobs if again else remaining(jobs, read_results(output), conditions)
    console.say(f"{len(jobs)} cells, {len(jobs) - len(left)} of them done before")
    for folder in (output, work) if left else ():
        make_writable(folder)
    found: list[CellResult] = []
    try:
        if left:
            _prepare(console, left, demo)
            found = _run(console, left, output, work)
    except BaseException:
        try:
            _write_report(console, jobs, conditions, output, work)
        except Exception as error:  # the error that ended the runs must be reported first
            console.say(f"no report: {error}")
        raise
    _write_report(console, jobs, conditions, output, work)
    _check_failures(found)


def _check_output(folder: Path) -> None:
    """Refuse a folder where a file of other content would be replaced.

    Raises:
        PocketGSError: a file has the name of a table, a chart or a report, and there are no results for these.
    """
    taken = [folder / name for name in (TABLE, OVERVIEW, REPORT) if (folder / name).exists()]
    if taken and not read_results(folder):
        raise PocketGSError(f"{taken[0]}: stands in a folder without results, expected another --output")


def _prepare(console: Terminal, jobs: Sequence[Job], demo: Path) -> None:
    with console.status("compiling kernels, and making the demo if it is missing; this is not part of any cell's time"):
        compile_kernels()
        if any(job.capture.name == DEMO for job in jobs):
            write_demo(demo)


def _run(console: Terminal, jobs: Sequence[Job], output: Path, work: Path) -> list[CellResult]:
    with console.status("") as status:

        def show_step(step: Step) -> None:
            left = "" if step.seconds_left is None else f", about {step.seconds_left / 60:.0f} min left"
            status.update(Text(f"{printable(step.cell.name)}: {step.number} of {step.count}{left}"))

        def show_result(result: CellResult) -> None:
            console.say(_line(result))

        return run_jobs(jobs, output, work, show_step, show_result)


def _line(result: CellResult) -> str:
    if result.error is not None:
        return f"{result.cell.name}: failed: {result.error}"
    run = result.run
    quality = f"{run['psnr']:.2f} dB, SSIM {run['ssim']:.4f}"
    return f"{result.cell.name}: {quality}, {result.wall_seconds:.1f} s, {run['peak_rss_mb']:.0f} MB"


def _write_report(console: Terminal, jobs: Sequence[Job], conditions: Conditions, output: Path, work: Path) -> None:
    kept = read_results(output)
    results = comparable(kept, jobs, conditions)
    if len(results) < len(kept):
        console.say(
            f"{len(kept) - len(results)} results of other captures, versions, machines or settings are left out"
        )
    if not results:
        return
    table, overview, report = output / TABLE, output / OVERVIEW, output / REPORT
    with replacing(table) as partial:
        partial.write_text(markdown_table(results), encoding="utf-8")
    write_overview(results, overview)
    write_report(results, work, report)
    console.say(f"{len(results)} results: {table}, {overview}, {report}")


def _check_failures(results: Sequence[CellResult]) -> None:
    failed = [result.cell.name for result in results if result.error is not None]
    if failed:
        raise PocketGSError(f"bench: {len(failed)} of {len(results)} cells failed: {', '.join(failed)}; see their logs")


def _print_list(console: Terminal, known: dict[str, BenchCapture]) -> None:
    methods = Table("method", "description", "flags of pocketgs train", box=box.SIMPLE)
    for method in METHODS.values():
        methods.add_row(method.name, method.what, " ".join(method.flags))
    captures = Table("capture", "description", "where", box=box.SIMPLE)
    for capture in known.values():
        where = str(capture.path) if capture.is_there else f"missing: expected in {capture.path}; {capture.origin}"
        captures.add_row(*(Text(printable(cell)) for cell in (capture.name, capture.what, where)))
    console.print(methods, captures, soft_wrap=False)
