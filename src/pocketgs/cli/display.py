"""Terminal output of a training run."""

from __future__ import annotations

import time
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from rich.live import Live
from rich.table import Table
from rich.text import Text

from pocketgs.capture.capture import Capture
from pocketgs.cli.terminal import Terminal, printable
from pocketgs.errors import counted
from pocketgs.metrics.evaluation import Evaluation, ImageMetrics
from pocketgs.prior.report import PriorReport
from pocketgs.results.reporter import Reporter
from pocketgs.results.run import RunResult
from pocketgs.system.process import peak_rss_mb
from pocketgs.training.planning.plan import Plan
from pocketgs.training.progress import Progress

STAGES = {
    "frames": "choosing frames",
    "features": "finding features",
    "matching": "matching features",
    "mapping": "finding poses",
    "capture": "reading the capture",
    "keyframes": "choosing keyframes",
    "poses": "matching features and refining poses",
    "depth": "computing depth (the first run compiles its kernels)",
    "fusion": "fusing depths into a cloud",
    "coverage": "filling holes of the cloud",
    "planning": "planning",
    "points": "choosing points to start from",
    "seeding": "seeding Gaussians",
    "compilation": "loading kernels (the first run compiles them: up to half a minute)",
    "upload": "preparing the engine",
    "compressing": "pruning, fine-tuning and rounding",
    "writing": "writing the result",
    "visibility": "measuring how much of each Gaussian is seen (the first run compiles kernels)",
    "evaluation": "evaluating the held-out views",
}
ITERATIONS_BETWEEN_LINES = 100
SECONDS_BETWEEN_LINES = 10.0
SECONDS_BEFORE_GUESSING = 2.0
"""Time before a stage's remaining time is estimated."""


class Display:
    """Shows stages and progress on one line that is redrawn, or as plain lines if the output is not a terminal."""

    def __init__(self, console: Terminal) -> None:
        self._console = console
        self._live: Live | None = None
        self._stage = ""
        self._begun = self._next_line = 0.0

    @contextmanager
    def showing(self) -> Iterator[Reporter]:
        """A reporter that shows progress while the block runs."""
        if self._console.is_terminal:
            with Live(Text(""), console=self._console, transient=True, refresh_per_second=8) as live:
                self._live = live
                yield self._reporter()
        else:
            yield self._reporter()

    def _reporter(self) -> Reporter:
        return Reporter(
            on_stage=self._show_stage,
            on_capture=self._show_capture,
            on_prior=self._show_prior,
            on_progress=self._show_progress,
            on_warning=self._show_warning,
            on_plan=self._show_plan,
            on_count=self._show_count,
        )

    def _show_stage(self, stage: str) -> None:
        self._stage, self._begun = stage, time.monotonic()
        self._next_line = self._begun + SECONDS_BETWEEN_LINES
        if stage in STAGES and self._live:
            self._live.update(Text(f"{STAGES[stage]} …"))
        elif stage == "compilation":
            self._console.say(STAGES[stage])

    def _show_count(self, done: int, of: int) -> None:
        now = time.monotonic()
        line = count_line(self._stage, done, of, now - self._begun)
        if self._live:
            self._live.update(Text(line))
        elif now >= self._next_line:
            self._next_line = now + SECONDS_BETWEEN_LINES
            self._console.say(line)

    def _show_capture(self, capture: Capture) -> None:
        for warning in capture.warnings:
            self._show_warning(warning)
        self._console.say(*capture_lines(capture))

    def _show_plan(self, plan: Plan) -> None:
        self._console.say(plan_line(plan))

    def _show_prior(self, report: PriorReport) -> None:
        for warning in report.warnings:
            self._show_warning(warning)
        self._console.say(prior_line(report))

    def _show_warning(self, warning: str) -> None:
        self._console.say(f"warning: {warning}", style="yellow")

    def _show_progress(self, progress: Progress) -> None:
        if self._live:
            self._live.update(Text(progress_line(progress)))
        elif progress.iteration % ITERATIONS_BETWEEN_LINES == 0:
            self._console.say(progress_line(progress))


def capture_lines(capture: Capture) -> list[str]:
    """Describe a capture."""
    points = f"{len(capture.points):,} points" if capture.points else "no points of its own"
    views = f"{len(capture.train)} training views, {len(capture.held_out)} held out"
    masked = sum(frame.mask is not None for frame in capture.frames)
    if masked:
        views += f", masks for {masked} of {len(capture.frames)}"
    units = "metres" if capture.metric else "scene units"
    return [
        f"{capture.name} ({capture.format}): {views}, {points}, {units}, {capture.image_bytes / 1e6:.0f} MB of images",
        f"protocol: {capture.protocol}",
    ]


def count_line(stage: str, done: int, of: int, seconds: float) -> str:
    """Progress of a stage, with its estimated remaining time."""
    line = f"{STAGES.get(stage, stage)}: {done}/{of}"
    if of / 10 < done < of and seconds >= SECONDS_BEFORE_GUESSING:
        line += f", about {max(1, round(seconds / done * (of - done)))} s left"
    return line


def plan_line(plan: Plan) -> str:
    """One line about a plan."""
    parts = [f"photographs up to {plan.width}x{plan.height}", f"at most {plan.gaussians:,} Gaussians"]
    parts.append(f"up to {plan.peak_rss_mb:.0f} MB of memory")
    if plan.device_mb:
        parts.append(f"{plan.device_mb:.0f} MB on the GPU")
    if plan.seconds is not None:
        parts.append(f"about {plan.iterations} iterations in {plan.seconds:.0f} s")
    return "plan: " + ", ".join(parts)


def prior_line(report: PriorReport) -> str:
    """One line about the result of the geometry prior."""
    parts = [f"{report.keyframes} keyframes of {len(report.decisions)} frames"]
    if report.rmse is not None and report.rmse_given is not None:
        change = f"{report.rmse_given:.2f} -> {report.rmse:.2f} px" if report.poses_refined else f"{report.rmse:.2f} px"
        parts.append(f"{report.sparse_points:,} sparse points")
        parts.append(f"poses {'refined' if report.poses_refined else 'as given'} (reprojection {change})")
    if report.gains is not None:
        parts.append(f"exposure compensated, gains {report.gains.min():.0%} to {report.gains.max():.0%}")
    parts.append(f"cloud of {report.points:,} points")
    if report.coverage is not None:
        known = f" ({report.coverage_known:.1%} by known depths)"
        parts.append(f"covers {report.coverage:.1%} of the training pixels{known}")
    return "prior: " + ", ".join(parts)


def progress_line(progress: Progress) -> str:
    """One line about the progress of a run."""
    rate = progress.iteration_rate
    parts = [
        f"iteration {progress.iteration}/{progress.iterations}",
        f"loss {progress.loss:.4f}",
        f"{rate:.1f} it/s",
        f"{progress.seconds_left:.0f} s left",
        f"{progress.gaussians:,} Gaussians",
        f"{peak_rss_mb():.0f} MB",
    ]
    if progress.gain_per_minute is not None:
        parts.insert(4, f"validation {progress.gain_per_minute:+.2f} dB/min")
    if progress.held_out_psnr is not None:
        parts.insert(2, f"held-out PSNR {progress.held_out_psnr:.2f} dB")
    return "  ".join(parts)


def print_result(console: Terminal, result: RunResult) -> None:
    """Print quality, time and memory of a run, and the path of its result."""
    summary = result.summary
    if result.evaluation:
        contradicted = summary["contradicted_views"]
        print_evaluation(console, result.evaluation, contradicted["names"] if contradicted else ())
    seconds = summary["seconds"]
    stages = ", ".join(f"{name} {value:.1f}" for name, value in seconds.items() if name != "total" and value >= 0.05)
    stopped = " (stopped early)" if summary["interrupted"] else ""
    buffers = sum(summary["engine_bytes"].values()) / 1e6
    engine = f"engine {summary['engine']} ({summary['device']}), its buffers {buffers:.0f} MB"
    lines = [
        f"{summary['iterations']} iterations{stopped}, {summary['gaussians']:,} Gaussians, {engine}",
        f"{seconds['total']:.1f} s in total ({stages}), peak memory {summary['peak_rss_mb']:.0f} MB",
        f"result in {result.folder}: scene.ply, run.json{', held_out/' if result.evaluation else ''}",
    ]
    moved = summary["transients"]
    if moved and moved["photographs"]:
        share = f"on average {moved['share']:.1%} of a photograph is left out, see transients/"
        shown = counted(moved["photographs"], "photograph shows", "photographs show")
        lines.insert(0, f"{shown} things that moved: {share}")
    if moved and moved["left_out"]:
        left_out = counted(len(moved["left_out"]), "photograph contradicts", "photographs contradict")
        names = ", ".join(printable(name) for name in moved["left_out"])
        lines.insert(0, f"{left_out} the others, left out of training (a wrong pose, or another place?): {names}")
    console.say(*lines)


@dataclass(frozen=True)
class Column:
    """A figure in the table of held-out views.

    Attributes:
        name: of the figure in `ImageMetrics` and `Evaluation`.
        title: of its column.
        decimals: that are shown.
    """

    name: str
    title: str
    decimals: int

    def text_of(self, metrics: ImageMetrics | Evaluation) -> str:
        """The figure, or that there is none."""
        value = getattr(metrics, self.name)
        return "n/a" if value is None else f"{value:.{self.decimals}f}"


COLUMNS = (
    Column("psnr", "PSNR (dB)", 2),
    Column("cc_psnr", "colour-corrected", 2),
    Column("ssim", "SSIM", 4),
    Column("flip", "FLIP", 4),
    Column("lpips", "LPIPS", 4),
)


def print_evaluation(console: Terminal, evaluation: Evaluation, apart: Collection[str] = ()) -> None:
    """Print a table of metrics per image, with means.

    Args:
        console: to print on.
        evaluation: of the held-out views.
        apart: names of views whose given poses are contradicted; there is a second mean, without them.
    """
    columns = [column for column in COLUMNS if getattr(evaluation, column.name) is not None]
    table = Table("held-out view", *(column.title for column in columns))
    for image in evaluation.images:
        table.add_row(Text(printable(image.name)), *(column.text_of(image) for column in columns))
    table.add_section()
    table.add_row("mean", *(column.text_of(evaluation) for column in columns))
    others = evaluation.without(apart) if apart else None
    if others:
        title = f"without {len(apart)} with contradicted poses"
        table.add_row(title, *(column.text_of(others) for column in columns))
    console.print(table, soft_wrap=False)
    if evaluation.lpips_note:
        console.say(evaluation.lpips_note, style="dim")
