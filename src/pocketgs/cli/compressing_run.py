"""A training run whose scene is compressed when it is done: `pocketgs train --compress`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from pocketgs.capture import Capture, ListedCapture
from pocketgs.cli.compression_table import closing_lines, figures_table, print_figures
from pocketgs.cli.terminal import Terminal
from pocketgs.compression.compress import compress
from pocketgs.compression.figures import Figures
from pocketgs.compression.options import CompressionOptions
from pocketgs.compression.views import photographed
from pocketgs.files.manifest import read_manifest
from pocketgs.results.folder import COMPRESSED, SCENE, publishing
from pocketgs.results.reporter import Reporter
from pocketgs.results.run import RunResult, run
from pocketgs.splat.engine import create_engine
from pocketgs.system.process import seconds_since_start
from pocketgs.training.options import TrainingOptions

TRAINING_TIME = 0.6
"""Share of a time budget for the run; the rest is for compression."""


class CompressingRun:
    """Trains and compresses.

    Args:
        folder: of the result.
        source: identifies the capture, see `pocketgs.files.manifest.source_of`.
        console: to print to.
    """

    def __init__(self, folder: Path, source: str, console: Terminal) -> None:
        self._folder, self._source, self._console = folder, source, console
        self._rows: list[Figures] = []
        self._lines: list[str] = []

    def run(
        self,
        list_capture: Callable[[], ListedCapture],
        options: TrainingOptions,
        resume: bool,
        reporter: Reporter,
    ) -> RunResult:
        """Train, then compress the scene with the photographs and poses that it was trained with.

        A run that was stopped is not compressed.

        Raises:
            PocketGSError: as `pocketgs.results.run.run` does, or another program's file is in the way.
        """
        read_manifest(self._folder).check_ours(self._folder, [COMPRESSED])
        prepared: list[Capture] = []

        def on_prepared(capture: Capture) -> None:
            prepared.append(capture)
            reporter.on_prepared(capture)

        budget = options.time_budget
        within = options if budget is None else replace(options, time_budget=TRAINING_TIME * budget)
        watched = replace(reporter, on_prepared=on_prepared)
        result = run(list_capture, self._folder, within, resume=resume, reporter=watched, source=self._source)
        if result.summary["interrupted"]:
            self._lines = [f"not compressed, since training was stopped: pocketgs compress {self._folder} does it"]
        else:
            self._compress(result, prepared[0], options, reporter)
        return result

    def _compress(self, result: RunResult, capture: Capture, options: TrainingOptions, reporter: Reporter) -> None:
        engine, views = create_engine(options.engine_options), photographed(capture)
        budget = options.time_budget
        seconds = None if budget is None else max(budget - seconds_since_start(), 1.0)
        reporter.on_stage("compressing")
        settings = CompressionOptions(seed=options.seed)
        found = compress(result.scene, views, engine, settings, seconds=seconds, on_count=reporter.on_count)
        with publishing(self._folder, [COMPRESSED]) as staging:
            (staging / COMPRESSED).write_bytes(found.chosen.contents)
        self._rows = figures_table(result.scene, (self._folder / SCENE).stat().st_size, found, engine, views)
        self._lines = closing_lines(found, self._folder / COMPRESSED)

    def print_result(self) -> None:
        """Print the table of size against quality, if there is one, and what was written."""
        if self._rows:
            print_figures(self._console, self._rows)
        self._console.say(*self._lines)
