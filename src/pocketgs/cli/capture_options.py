"""Reading captures for subcommands, and refusing options that cannot be right, or would have no effect."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import fields
from pathlib import Path

from pocketgs.capture import Capture, list_capture
from pocketgs.capture.masks import check_for_video, masks_folder
from pocketgs.capture.options import CaptureOptions
from pocketgs.capture.unposed import is_video
from pocketgs.cli.terminal import Terminal
from pocketgs.errors import PocketGSError


def read_capture(path: Path, reading: CaptureOptions) -> Capture:
    """Read the capture at `path`, and print its reader's warnings to standard error.

    Raises:
        PocketGSError: the capture or an option is not usable.
    """
    capture = list_capture(path, reading).load()
    warnings = [f"warning: {warning}" for warning in capture.warnings]
    Terminal(to_errors=True).say(*warnings, style="yellow")
    return capture


def check_without_poses(reading: CaptureOptions, path: Path, made: Path) -> None:
    """Refuse options that cannot be right for photographs or a video, before poses are sought for minutes.

    Args:
        reading: the options.
        path: of the photographs or the video.
        made: the capture that is made of them, which an earlier run may have left.

    Raises:
        PocketGSError: images are chosen by folder, the named masks are not there, or a video's masks cannot be its own.
    """
    if reading.images is not None:
        raise PocketGSError(
            f"{path}: has no poses, so that --images {reading.images} has nothing to choose from: leave it out, and "
            "give the folder of the photographs themselves as the capture"
        )
    # A video's frames, and so their masks, belong to the capture that is made.
    masks = masks_folder(made if is_video(path) else path, reading.masks)
    if is_video(path) and masks is not None:
        check_for_video(path, masks)


def check_without_capture(reading: CaptureOptions, expected: str, but: Collection[str] = ()) -> None:
    """Refuse options that would have no effect, because no capture is read.

    Args:
        reading: the options.
        expected: what gives a capture, for the message.
        but: names of options that have an effect in any case.

    Raises:
        PocketGSError: an option is given.
    """
    for field in fields(reading):
        if field.name not in but and getattr(reading, field.name) != field.default:
            flag = field.name.replace("_", "-")
            raise PocketGSError(f"--{flag} only applies to a capture: give {expected}, or leave the option out")
