"""`pocketgs distil`."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import tyro

from pocketgs.capture.options import CaptureOptions
from pocketgs.cli.capture_options import check_without_capture
from pocketgs.cli.display import Display
from pocketgs.cli.output_file import SCENE_FILE, check_place
from pocketgs.cli.own_views import cameras_of_result, rendered_capture
from pocketgs.cli.scene_file import as_trained_on, load_scene, read_for, run_of, without_broken
from pocketgs.cli.terminal import Terminal
from pocketgs.compression.views import photographed
from pocketgs.files.memory_bound import DEFAULT_MB, memory_bound, require_memory
from pocketgs.geometry.camera import Camera
from pocketgs.scene.edits import drawable
from pocketgs.scene.gaussians import Gaussians
from pocketgs.sort_free.distil import DistilOptions, memory_needed
from pocketgs.sort_free.distil import distil as distil_scene
from pocketgs.sort_free.file import check_name, check_storable, write_sort_free
from pocketgs.splat.choose_engine import create_engine


def distil(
    scene: Annotated[Path, tyro.conf.Positional],
    capture: Annotated[Path | None, tyro.conf.Positional] = None,
    *,
    output: Path,
    poses_of: Path | None = None,
    options: DistilOptions = DistilOptions(),  # noqa: B008 - a frozen dataclass
    reading: CaptureOptions = CaptureOptions(),  # noqa: B008 - a frozen dataclass
    max_memory: int = DEFAULT_MB,
) -> None:
    """Train a scene that is drawn without sorting from one that is drawn sorted.

    Args:
        scene: A trained scene: a file (.ply, .spz, .splat, .glb …), or a result folder.
        capture: The capture that it was trained on. Without it, renderings of the scene itself take the photographs'
            place, from the cameras of its result.
        output: The file to write: a .ply, or a small .pgs. PocketGS draws both as trained; other programs read the
            .ply but sort its Gaussians.
        poses_of: The result folder of the scene's run, if the scene lies outside it: for its poses, background and
            what moved.
        options: Options of distilling.
        reading: Options for reading the capture.
        max_memory: Megabytes that reading, and distilling, may take; what needs more is refused before it starts.
    """
    console, run = Terminal(), run_of(scene, poses_of)
    check_name(output)
    check_place(output, SCENE_FILE, [scene, *([capture] if capture else [])])
    if capture is None:
        check_without_capture(reading, "the capture after the scene", but=("background",))
    with memory_bound(max_memory):
        teacher = drawable(without_broken(scene, load_scene(scene)))
        check_storable(output, teacher)
        if capture is None:
            _require_memory(scene, teacher, cameras_of_result(run).values(), options)
            engine = create_engine(options.engine_options)
            opened = rendered_capture(run, teacher, engine, reading.background)
        else:
            opened = as_trained_on(run, read_for(run, capture, reading))
            opened = replace(opened, train=photographed(opened).train)
            _require_memory(scene, teacher, [frame.camera for frame in opened.train], options)
    with Display(console).showing() as reporter:
        stages: list[str] = []

        def show(stage: str, done: int, of: int) -> None:
            if stage not in stages:
                stages.append(stage)
                reporter.on_stage(stage)
            reporter.on_count(done, of)

        found = distil_scene(teacher, opened, options, show)
    write_sort_free(output, found.scene)
    ended = f"stopped after {found.iterations} of {options.iterations} steps: " if found.interrupted else ""
    size = output.stat().st_size
    console.say(f"{ended}{len(found.scene):,} Gaussians in {output}, {size:,} bytes, drawn by {options.compositor}")


def _require_memory(scene: Path, teacher: Gaussians, cameras: Iterable[Camera], options: DistilOptions) -> None:
    require_memory(scene, memory_needed(teacher, cameras, options), "distilling")
