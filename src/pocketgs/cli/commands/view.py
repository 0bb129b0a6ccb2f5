"""`pocketgs view`."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated

import tyro

from pocketgs.capture.options import CaptureOptions
from pocketgs.cli.capture_options import check_without_capture
from pocketgs.cli.page import PageOptions, announce, wait_for_ctrl_c
from pocketgs.cli.scene_file import in_world_of, load_any, read_for, run_of
from pocketgs.cli.terminal import Terminal
from pocketgs.errors import PocketGSError
from pocketgs.files.memory_bound import DEFAULT_MB, memory_bound
from pocketgs.files.opening import reading_inside
from pocketgs.results.folder import SCENE
from pocketgs.sort_free.file import write_sort_free
from pocketgs.sort_free.scene import SortFreeScene


def view(
    scene: Annotated[Path, tyro.conf.Positional],
    capture: Path | None = None,
    poses_of: Path | None = None,
    max_memory: int = DEFAULT_MB,
    page: PageOptions = PageOptions(),  # noqa: B008 - a frozen dataclass
    reading: CaptureOptions = CaptureOptions(),  # noqa: B008 - likewise
) -> None:
    """Show a scene in the browser, until Ctrl-C.

    Args:
        scene: A file with Gaussians, or a result folder.
        capture: The capture's folder or its transforms.json, for its cameras and for photographs to compare with.
        poses_of: The result folder of the scene's run, if the scene lies outside it: for its poses, background and
            split. Only with a capture.
        max_memory: Megabytes that reading may take; larger files are refused.
        page: Options of the page's server.
        reading: Options for reading the capture.
    """
    from pocketgs.viewer.readable import readable_file, write_copy
    from pocketgs.viewer.scene_content import scene_content
    from pocketgs.viewer.server import serving

    if capture is None:
        check_without_capture(reading, "--capture")
        if poses_of is not None:
            raise PocketGSError("--poses-of only applies to a capture: give --capture, or leave the option out")
    run = run_of(scene, poses_of)
    with memory_bound(max_memory):
        with reading_inside(scene if scene.is_dir() else None):
            shown = load_any(scene)
        opened = in_world_of(run, read_for(run, capture, reading)) if capture else None
    is_result = scene.is_dir()
    title = scene.resolve().name if is_result else scene.stem
    original = scene / SCENE if is_result else scene
    if isinstance(shown, SortFreeScene):
        gaussians, write = shown.gaussians, partial(write_sort_free, scene=shown)
    else:
        gaussians, write = shown, partial(write_copy, gaussians=shown, original=original)
    with readable_file(original, write) as file:
        content = scene_content(title, file, gaussians, scene if is_result else None, opened)
        content = replace(content, is_copy=file != original)
        with serving(content, network=page.host, port=page.port) as served:
            announce(served, page)
            Terminal().say("Ctrl-C stops it")
            wait_for_ctrl_c()
