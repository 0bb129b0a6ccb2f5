"""`pocketgs serve`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, get_args

import tyro

from pocketgs.capture.options import CaptureOptions
from pocketgs.cli.flags import flags_of
from pocketgs.cli.page import PageOptions, announce, wait_for_ctrl_c
from pocketgs.cli.terminal import Terminal
from pocketgs.errors import PocketGSError
from pocketgs.splat.choose_engine import chosen_engine
from pocketgs.system.device import MB
from pocketgs.training.options import Effort, TrainingOptions


def serve(
    folder: Annotated[Path, tyro.conf.Positional],
    max_upload: int = 4000,
    page: PageOptions = PageOptions(host=True),  # noqa: B008 - a frozen dataclass
    reading: CaptureOptions = CaptureOptions(max_size=800),  # noqa: B008 - a frozen dataclass
    training: TrainingOptions = TrainingOptions(),  # noqa: B008 - a frozen dataclass
) -> None:
    """Serve a page on which phones in the local network upload photographs, videos or captures, and train them here.

    Args:
        folder: Folder for captures and results; created if needed. Uploads never leave it.
        max_upload: Most megabytes of one upload, and of what an archive unpacks to.
        page: Options of the page's server. Unless --no-host is given, the local network is served.
        reading: Options for reading captures.
        training: Options of training; the page asks for the effort.
    """
    from pocketgs.serve.server import ServeOptions, serving_folder

    if max_upload < 1:
        raise PocketGSError(f"max upload: found {max_upload}, expected at least 1 MB")
    chosen_engine(training.engine_options)
    efforts: tuple[Effort, ...] = get_args(Effort)
    flags: dict[str, tuple[str, ...]] = {
        effort: (*flags_of(reading), *flags_of(replace(training, effort=effort))) for effort in efforts
    }
    options = ServeOptions(flags, training.effort, max_upload * MB, network=page.host, port=page.port)
    with serving_folder(folder, options) as (served, warnings):
        console = Terminal()
        announce(served, page)
        console.say(*(f"warning: {warning}" for warning in warnings), style="yellow")
        console.say(f"captures and results are kept in {folder}; Ctrl-C stops the server")
        wait_for_ctrl_c()
        console.say("stopping: a run that goes on keeps what it has trained, and the next start goes on with it")
