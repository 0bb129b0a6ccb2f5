"""`pocketgs export-colmap`."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated

import tyro

from pocketgs.capture.colmap_export import export_capture
from pocketgs.capture.options import CaptureOptions
from pocketgs.cli.capture_options import read_capture
from pocketgs.cli.scene_file import capture_of, checked_result, in_world_of, warn
from pocketgs.cli.terminal import Terminal
from pocketgs.files.memory_bound import DEFAULT_MB, memory_bound

NO_POINTS = (
    "the capture's points do not fit its poses as they were read, and are left out: start other trainers from random "
    "points, or from scene.ply"
)


def export_colmap(
    capture: Annotated[Path, tyro.conf.Positional],
    output: Annotated[Path, tyro.conf.Positional],
    poses_of: Path | None = None,
    max_memory: int = DEFAULT_MB,
    reading: CaptureOptions = CaptureOptions(),  # noqa: B008 - a frozen dataclass
) -> None:
    """Write a capture's images, cameras and points as a COLMAP text model.

    Args:
        capture: The capture's folder, or its transforms.json.
        output: A new or empty folder, for images/ and sparse/0/.
        poses_of: A result folder whose refined poses are written instead of the capture's own.
        max_memory: Megabytes that reading may take; larger files are refused.
        reading: Options for reading the capture; images are written as read.
    """
    if poses_of is not None:
        poses_of = checked_result(poses_of)
    with memory_bound(max_memory):
        opened = read_capture(capture if poses_of is None else capture_of(poses_of, capture), reading)
    if poses_of is not None:
        own = opened.points
        opened = in_world_of(poses_of, opened)
        if own is not None and opened.points is None:
            warn(poses_of, NO_POINTS)
    export_capture(output, opened, reading.hold_out, partial(warn, output))
    points = 0 if opened.points is None else len(opened.points)
    said = f"{len(opened.frames)} images and cameras, {points:,} points in {output} ({opened.protocol})"
    Terminal().say(said)
