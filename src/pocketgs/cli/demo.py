"""`pocketgs demo`."""

from __future__ import annotations

from pathlib import Path

from rich.console import Console

from pocketgs.capture.synthetic import demo_capture
from pocketgs.cli.display import Display, print_result
from pocketgs.run import run
from pocketgs.training import TrainingOptions


def demo(
    output: Path = Path("output/demo"),
    training: TrainingOptions = TrainingOptions(),  # noqa: B008 - a frozen dataclass
) -> None:
    """Train on a small built-in capture, to see that everything works.

    Args:
        output: Folder for the result.
        training: How to train.
    """
    console = Console()
    display = Display(console)
    with display.showing() as reporter:
        result = run(demo_capture, output, training, reporter=reporter)
    print_result(console, result)
    console.print("look at the pictures in held_out/ (photograph left, rendering right)", highlight=False)
