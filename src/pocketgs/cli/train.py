"""`pocketgs train`."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console

from pocketgs.cli.capture_options import CaptureOptions
from pocketgs.cli.display import Display, print_result
from pocketgs.run import run
from pocketgs.training import TrainingOptions


def train(
    capture: Annotated[Path, tyro.conf.Positional],
    output: Path | None = None,
    resume: bool = False,
    reading: CaptureOptions = CaptureOptions(),  # noqa: B008 - a frozen dataclass
    training: TrainingOptions = TrainingOptions(),  # noqa: B008
) -> None:
    """Train a splat from a capture.

    Args:
        capture: A capture's folder, or its transforms.json.
        output: Folder for the result; by default output/NAME.
        resume: Go on from the checkpoint in the output folder.
        reading: How to read the capture.
        training: How to train.
    """
    console = Console()
    resolved = capture.resolve()
    name = (resolved.parent if resolved.is_file() else resolved).name
    folder = output or Path("output") / (name or "capture")
    display = Display(console)
    with display.showing() as reporter:
        result = run(partial(reading.open, capture), folder, training, resume=resume, reporter=reporter)
    print_result(console, result)
