"""`pocketgs eval`."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import tyro

from pocketgs.capture.options import CaptureOptions
from pocketgs.cli.output_file import check_place, json_with
from pocketgs.cli.run_lines import capture_lines
from pocketgs.cli.run_result import print_evaluation
from pocketgs.cli.scene_file import check_unseen, drawn_by, in_world_of, read_for, run_of
from pocketgs.cli.terminal import Terminal
from pocketgs.errors import PocketGSError
from pocketgs.files.memory_bound import memory_bound
from pocketgs.files.plain_names import plain_names
from pocketgs.results.folder import publishing_pictures, write_json
from pocketgs.results.held_out import evaluate_held_out
from pocketgs.splat.engine import EngineOptions

FIGURES = json_with("figures of eval", "psnr", "protocol", "gaussians", "images")


def evaluate(
    scene: Annotated[Path, tyro.conf.Positional],
    capture: Annotated[Path, tyro.conf.Positional],
    pictures: Path | None = None,
    json: Path | None = None,
    poses_of: Path | None = None,
    engine: EngineOptions = EngineOptions(),  # noqa: B008 - a frozen dataclass
    reading: CaptureOptions = CaptureOptions(),  # noqa: B008 - a frozen dataclass
) -> None:
    """Compare a scene with a capture's held-out views: PSNR, SSIM, FLIP, LPIPS.

    Args:
        scene: A scene file (.ply, .pgs, .spz, .glb …), or a result folder.
        capture: The capture's folder, or its transforms.json.
        pictures: Folder for images of photograph and rendering side by side, in place of those of an earlier command.
        json: File for the metrics.
        poses_of: The result folder of the scene's run, if the scene lies outside it: for its poses, background and
            split.
        engine: Options of the engine.
        reading: Options for reading the capture.
    """
    console, run = Terminal(), run_of(scene, poses_of)
    if json:
        check_place(json, FIGURES, [scene, capture])
    if json and pictures and json.resolve() == pictures.resolve():
        raise PocketGSError(f"{json}: named by both --pictures and --json, expected a folder and a file")
    with memory_bound(engine.max_memory):
        renderer, gaussians = drawn_by(scene, engine)
        opened = in_world_of(run, read_for(run, capture, reading))
    if not opened.held_out:
        raise PocketGSError(
            f"{capture}: no view is held out, expected --hold-out of 2 to the number of its photographs"
        )
    check_unseen(run, opened)
    names = [f"{name}.png" for name in plain_names(frame.name for frame in opened.held_out)]
    with publishing_pictures(pictures, names) if pictures else nullcontext() as staging:
        evaluation = evaluate_held_out(renderer, opened, staging)
    assert evaluation is not None
    # Before anything is printed: the output may be a pipe that has been closed.
    if json:
        images = [asdict(image) for image in evaluation.images]
        write_json(json, {**evaluation.means, "protocol": opened.protocol, "gaussians": gaussians, "images": images})
    console.say(*capture_lines(opened))
    print_evaluation(console, evaluation)
