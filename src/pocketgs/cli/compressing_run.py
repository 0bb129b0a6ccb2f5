"""A training run whose scene is compressed when it is done: `pocketgs train --compress`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from pocketgs.capture import Capture, ListedCapture
from pocketgs.cli.compression_table import closing_lines, figures_table, print_figures
from pocketgs.cli.terminal import Terminal
from pocketgs.cli.timed_compression import compress_in_time
from pocketgs.compression.compress import memory_needed
from pocketgs.compression.figures import Figures
from pocketgs.compression.options import CompressionOptions
from pocketgs.compression.views import Views, photographed
from pocketgs.errors import PocketGSError
from pocketgs.files.memory_bound import require_memory
from pocketgs.results.folder import COMPRESSED, SCENE, write_compressed
from pocketgs.results.reporter import Reporter
from pocketgs.results.run import RunResult, run
from pocketgs.results.transients import without_transients
from pocketgs.scene.edits import drawable
from pocketgs.scene.formats.pgs import warn_of_coarse_grid
from pocketgs.splat.choose_engine import create_engine
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
        self._views: Views | None = None
        self._lines: list[str] = []

    def run(
        self,
        list_capture: Callable[[], ListedCapture],
        options: TrainingOptions,
        resume: bool,
        reporter: Reporter,
    ) -> RunResult:
        """Train, then compress the scene with the photographs and poses that it was trained with.

        A run that was stopped is not compressed. What ends compression early does not end the run.

        Raises:
            PocketGSError: as `pocketgs.results.run.run` does, or another program's file is in the way.
        """
        prepared: list[Capture] = []

        def on_prepared(capture: Capture) -> None:
            prepared.append(capture)
            reporter.on_prepared(capture)

        budget = options.time_budget
        within = options if budget is None else replace(options, time_budget=TRAINING_TIME * budget)
        watched = replace(reporter, on_prepared=on_prepared)
        result = run(list_capture, self._folder, within, resume=resume, reporter=watched, source=self._source)
        if result.stopped:
            self._lines = [f"not compressed, since the run was stopped: {self._later}"]
            return result
        try:
            self._compress(result, prepared[0], options, reporter)
        except KeyboardInterrupt:
            later = "" if self._lines else f": {self._later}"
            self._lines.append(f"{self._missing}, since it was stopped{later}")
        except (PocketGSError, OSError) as error:
            self._lines.append(f"{self._missing}: {error}")
        return result

    @property
    def _later(self) -> str:
        return f"pocketgs compress {self._folder} CAPTURE --output {self._folder / COMPRESSED} does it"

    @property
    def _missing(self) -> str:
        """What is missing where compression ends early: the file, or the table after it."""
        return "no table" if self._lines else "not compressed"

    def _compress(self, result: RunResult, capture: Capture, options: TrainingOptions, reporter: Reporter) -> None:
        reporter.on_stage("compressing")
        engine = create_engine(options.engine_options)
        original, views = drawable(result.scene), photographed(without_transients(capture, result.transients))
        needed = memory_needed(original, [frame.camera for frame in views.train], engine)
        require_memory(self._folder, needed, "compression")
        found = compress_in_time(
            original,
            views,
            engine,
            CompressionOptions(seed=options.seed),
            engine_options=options.engine_options,
            time_budget=options.time_budget,
            on_count=reporter.on_count,
        )
        write_compressed(self._folder, found.chosen.contents)
        warn_of_coarse_grid(self._folder / COMPRESSED, found.chosen.scene)
        self._lines = closing_lines(found, self._folder / COMPRESSED)
        self._rows = figures_table(original, (self._folder / SCENE).stat().st_size, found, engine, views)
        self._views = views

    def print_result(self) -> None:
        """Print the table of size against quality, if there is one, and what was written."""
        if self._views is not None:
            print_figures(self._console, self._rows, self._views)
        self._console.say(*self._lines)
