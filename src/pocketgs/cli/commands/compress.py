"""`pocketgs compress`."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import tyro

from pocketgs.capture.options import CaptureOptions
from pocketgs.cli.capture_options import check_without_capture
from pocketgs.cli.compression_table import closing_lines, figures_table, print_figures
from pocketgs.cli.display import Display
from pocketgs.cli.output_file import SCENE_FILE, check_place, json_with
from pocketgs.cli.own_views import own_background, own_cameras
from pocketgs.cli.scene_file import (
    as_trained_on,
    folder_of,
    load_scene,
    names_scene,
    read_for,
    run_of,
    without_broken,
)
from pocketgs.cli.terminal import Terminal
from pocketgs.cli.timed_compression import compress_in_time
from pocketgs.compression.compress import memory_needed
from pocketgs.compression.options import CompressionOptions
from pocketgs.compression.views import Views, photographed, rendered
from pocketgs.errors import PocketGSError
from pocketgs.files.atomic_file import replacing
from pocketgs.files.manifest import read_manifest
from pocketgs.files.memory_bound import memory_bound, require_memory
from pocketgs.results.folder import COMPRESSED, SCENE, check_compressed, write_compressed, write_json
from pocketgs.results.held_out import check_comparable
from pocketgs.scene.edits import drawable
from pocketgs.scene.formats.pgs import warn_of_coarse_grid
from pocketgs.scene.gaussians import Gaussians
from pocketgs.splat.choose_engine import create_engine
from pocketgs.splat.engine import Engine, EngineOptions

SUFFIX = ".pgs"
FIGURES = json_with("figures of compress", "photographs", "reported", "figures")


def compress(
    scene: Annotated[Path, tyro.conf.Positional],
    capture: Annotated[Path | None, tyro.conf.Positional] = None,
    *,
    output: Path,
    json: Path | None = None,
    poses_of: Path | None = None,
    compression: CompressionOptions = CompressionOptions(),  # noqa: B008 - a frozen dataclass
    engine: EngineOptions = EngineOptions(),  # noqa: B008 - a frozen dataclass
    reading: CaptureOptions = CaptureOptions(),  # noqa: B008 - a frozen dataclass
) -> None:
    """Compress a scene to a small .pgs file: prune it, fine-tune what is left, and round it.

    Ctrl-C writes the best file so far, or, if there is none within the bound, leaves an existing file as it is.

    Args:
        scene: A scene file (.ply, .spz, .splat, .glb …), or a result folder.
        capture: The capture that it was trained on: its folder, or its transforms.json. Without it, renderings of the
            scene itself take the photographs' place, from the cameras of its result, or from around it.
        output: The file to write, which ends in .pgs.
        json: File for the figures of the table.
        poses_of: The result folder of the scene's run, if the scene lies outside it: for its poses, background,
            split and what moved.
        compression: Options of the compression.
        engine: Options of the engine.
        reading: Options for reading the capture.
    """
    _check_names(scene, capture, output, json)
    if capture is None:
        check_without_capture(reading, "the capture after the scene", but=("background",))
    console, run = Terminal(), run_of(scene, poses_of)
    # For the whole work: files are read back to be judged.
    with memory_bound(engine.max_memory):
        original = drawable(without_broken(scene, load_scene(scene)))
        size = (scene / SCENE if scene.is_dir() else scene).stat().st_size
        renderer = create_engine(engine)
        views = _views(scene, run, original, capture, renderer, reading)
        check_comparable([*views.judges, *views.reported])
        with Display(console).showing() as shown:
            shown.on_stage("compressing")
            found = compress_in_time(
                original,
                views,
                renderer,
                compression,
                engine_options=engine,
                time_budget=compression.time_budget,
                on_count=shown.on_count,
            )
        if _is_of_result(scene, output):
            write_compressed(output.parent, found.chosen.contents)
        else:
            with replacing(output) as partial:
                partial.write_bytes(found.chosen.contents)
        warn_of_coarse_grid(output, found.chosen.scene)
        console.say(*closing_lines(found, output))
        rows = figures_table(original, size, found, renderer, views)
    print_figures(console, rows, views)
    if json:
        names = [frame.name for frame in views.reported]
        figures = [asdict(row) for row in rows]
        write_json(json, {"photographs": views.photographs, "reported": names, "figures": figures})


def _check_names(scene: Path, capture: Path | None, output: Path, json: Path | None) -> None:
    """Refuse names that cannot be right before any work.

    Raises:
        PocketGSError: the output is no .pgs, it or the figures cannot be written where they are to be, both would be
            one file, or the scene is none.
    """
    if output.suffix.lower() != SUFFIX:
        raise PocketGSError(f"{output}: not the name of a compressed scene, expected one that ends in {SUFFIX}")
    if json and json.resolve() == output.resolve():
        raise PocketGSError(f"{json}: named by both --output and --json, expected two files")
    inputs = [scene, *([capture] if capture else [])]
    if _is_of_result(scene, output):
        check_compressed(output.parent)
    else:
        check_place(output, SCENE_FILE, inputs)
    if json:
        check_place(json, FIGURES, inputs)
    if not names_scene(scene):
        raise PocketGSError(f"{scene}: no scene, expected a scene file or a result folder, then the capture")


def _is_of_result(scene: Path, output: Path) -> bool:
    """Whether the output is the compressed scene in the result folder of the scene, as `train --compress` writes it."""
    folder = folder_of(scene)
    is_place = output.name == COMPRESSED and output.parent.resolve() == folder.resolve()
    return is_place and SCENE in read_manifest(folder).files


def _views(
    scene: Path, run: Path, original: Gaussians, capture: Path | None, engine: Engine, reading: CaptureOptions
) -> Views:
    """The views to fine-tune, judge and report on; `run` tells how the scene was trained, see `run_of`.

    Raises:
        PocketGSError: the capture, or a file of the result folder, cannot be read, or compression would take too much
            memory.
    """
    if capture is not None:
        opened = as_trained_on(run, read_for(run, capture, reading))
        require_memory(scene, memory_needed(original, [frame.camera for frame in opened.train], engine), "compression")
        return photographed(opened)
    background = reading.background or own_background(run)
    chosen = own_cameras(run, original)
    require_memory(scene, memory_needed(original, chosen.values(), engine), "compression")
    return rendered(original, chosen, engine, background)
