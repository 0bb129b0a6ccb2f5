"""`pocketgs demo`."""

from __future__ import annotations

from pathlib import Path

from pocketgs.capture import ListedCapture, list_capture
from pocketgs.capture.synthetic import write_demo
from pocketgs.cli.page import FollowOptions
from pocketgs.cli.shown_run import show_run
from pocketgs.cli.terminal import Terminal
from pocketgs.files.manifest import source_of
from pocketgs.files.memory_bound import memory_bound
from pocketgs.results.folder import check_free_for
from pocketgs.results.reporter import Reporter
from pocketgs.results.run import RunResult, run
from pocketgs.training.options import TrainingOptions


def demo(
    output: Path | None = None,
    capture: Path = Path("output/demo-capture"),
    training: TrainingOptions = TrainingOptions(effort="quick"),  # noqa: B008 - a frozen dataclass
    page: FollowOptions = FollowOptions(),  # noqa: B008 - a frozen dataclass
) -> None:
    """Make a synthetic phone capture and train on it, to check that everything works.

    Args:
        output: Folder for the result; by default output/demo.
        capture: Folder for the capture, with ground-truth poses and depths; made once.
        training: Options of training.
        page: Options of the page that follows the run.
    """
    folder, source = output or Path("output/demo"), source_of(capture)
    if output is None:
        check_free_for(folder, source)

    def film() -> ListedCapture:
        write_demo(capture)
        return list_capture(capture)

    def work(reporter: Reporter) -> RunResult:
        return run(film, folder, training, reporter=reporter, source=source)

    hint = "look at the pictures in held_out/ (photograph left, rendering right)"
    with memory_bound(training.max_memory):
        show_run(Terminal(), work, page, "demo", closing_line=hint)
