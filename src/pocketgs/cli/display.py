"""Progress of a command on the terminal."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

from rich.live import Live
from rich.text import Text

from pocketgs.capture.capture import Capture
from pocketgs.cli.run_lines import STAGES, capture_lines, count_line, plan_line, prior_line, progress_line
from pocketgs.cli.terminal import Terminal
from pocketgs.prior.report import PriorReport
from pocketgs.results.reporter import Reporter
from pocketgs.training.planning.plan import Plan
from pocketgs.training.progress import Progress

ITERATIONS_BETWEEN_LINES = 100
SECONDS_BETWEEN_LINES = 10.0
LONG_STAGES = ("poses", "depth", "compilation")
"""Stages without counts that take minutes on large captures: plain lines name them."""


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
        # A dumb terminal cannot redraw a line.
        if self._console.is_terminal and not self._console.is_dumb_terminal:
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
        elif stage in LONG_STAGES:
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
