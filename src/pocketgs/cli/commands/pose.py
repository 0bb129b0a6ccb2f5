"""`pocketgs pose`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import tyro

from pocketgs.cli.display import Display
from pocketgs.cli.terminal import Terminal
from pocketgs.files.memory_bound import DEFAULT_MB, memory_bound
from pocketgs.structure_from_motion.options import PoseOptions
from pocketgs.structure_from_motion.pose import pose as find_poses


def pose(
    images_or_video: Annotated[Path, tyro.conf.Positional],
    output: Path,
    options: PoseOptions = PoseOptions(),  # noqa: B008 - a frozen dataclass
    max_memory: int = DEFAULT_MB,
) -> None:
    """Find the poses of photographs or a video, and write a capture.

    Args:
        images_or_video: A folder with photographs, or a video.
        output: Folder for the capture, which train and other commands accept.
        options: Options of structure from motion.
        max_memory: Megabytes that reading a photograph may take; larger ones are refused.
    """
    console = Terminal()
    with memory_bound(max_memory), Display(console).showing() as reporter:
        found = find_poses(
            images_or_video,
            output,
            options,
            on_stage=reporter.on_stage,
            on_count=reporter.on_count,
            on_warning=reporter.on_warning,
        )
    lines = [
        f"{found.registered} of {found.frames} images posed, {found.points:,} points, "
        f"mean reprojection error {found.reprojection_error:.2f} pixels"
        + (", in metres by the photographs' GPS positions" if found.metric else ""),
        f"capture in {found.folder}",
    ]
    console.say(*lines)
