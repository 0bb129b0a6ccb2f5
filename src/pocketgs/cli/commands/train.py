"""`pocketgs train`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import tyro

from pocketgs.capture import ListedCapture, list_capture
from pocketgs.capture.masks import FOUND, NONE, check_has_masks
from pocketgs.capture.open import capture_name, is_transforms_file, lacks_poses, video_of
from pocketgs.capture.options import CaptureOptions
from pocketgs.capture.unposed import is_video
from pocketgs.cli.capture_options import check_without_poses
from pocketgs.cli.compressing_run import CompressingRun
from pocketgs.cli.page import FollowOptions
from pocketgs.cli.shown_run import show_run
from pocketgs.cli.terminal import Terminal
from pocketgs.files.manifest import source_of
from pocketgs.files.memory_bound import memory_bound
from pocketgs.results.folder import check_free_for, posed_folder
from pocketgs.results.reporter import Reporter
from pocketgs.results.run import RunResult, run
from pocketgs.structure_from_motion.folder import MASKS
from pocketgs.structure_from_motion.images import source_masks
from pocketgs.structure_from_motion.options import PoseOptions
from pocketgs.structure_from_motion.pose import pose_once
from pocketgs.training.options import TrainingOptions


def train(
    capture: Annotated[Path, tyro.conf.Positional],
    output: Path | None = None,
    resume: bool = False,
    compress: bool = False,
    reading: CaptureOptions = CaptureOptions(),  # noqa: B008 - a frozen dataclass
    training: TrainingOptions = TrainingOptions(),  # noqa: B008
    page: FollowOptions = FollowOptions(),  # noqa: B008 - a frozen dataclass
) -> None:
    """Train a splat from a capture.

    Args:
        capture: A capture's folder or its transforms.json; or photographs or a video, whose poses are found first.
        output: Folder for the result; by default output/NAME.
        resume: Continue from the checkpoint in the output folder.
        compress: Also write scene.pgs, the scene compressed to within 0.3 dB, beside scene.ply; of a time budget, two
            fifths are for that.
        reading: Options for reading the capture.
        training: Options of training.
        page: Options of the page that follows the run.
    """
    console, capture = Terminal(), video_of(capture)
    name, resolved = capture_name(capture), capture.resolve()
    # A folder and the transforms.json in it are one capture; a folder and a video of the same name are two.
    source = source_of(resolved.parent if is_transforms_file(resolved) else resolved)
    folder = output or Path("output") / name
    if output is None:
        check_free_for(folder, source)

    compressing = CompressingRun(folder, source, console)

    def work(reporter: Reporter) -> RunResult:
        def listed() -> ListedCapture:
            return _listed(capture, folder, reading, console, reporter)

        if not compress:
            return run(listed, folder, training, resume=resume, reporter=reporter, source=source)
        return compressing.run(listed, training, resume, reporter)

    with memory_bound(training.max_memory):
        show_run(console, work, page, name)
    compressing.print_result()


def _listed(
    capture: Path, folder: Path, reading: CaptureOptions, console: Terminal, reporter: Reporter
) -> ListedCapture:
    """List a capture; poses of photographs or a video are found first, and kept in the result's folder."""
    if not lacks_poses(capture):
        return list_capture(capture, reading)
    found = posed_folder(folder, capture)
    check_without_poses(reading, capture, found)
    console.say(f"{capture} has no poses: structure from motion finds them and keeps them in {found}")
    # Masks have the names of photographs; a video's frames get theirs only now.
    masks = FOUND if is_video(capture) else reading.masks
    if reading.outside_masks == "empty":
        check_has_masks(capture, _may_have_masks(capture, found, reading.masks))
    made = pose_once(
        capture,
        found,
        PoseOptions(masks=masks),
        on_stage=reporter.on_stage,
        on_count=reporter.on_count,
        on_warning=reporter.on_warning,
    )
    # Named masks have been copied to the capture, and still are masks that must not be ignored.
    are_copied = masks not in (FOUND, NONE)
    return list_capture(made, replace(reading, masks=MASKS) if are_copied else reading)


def _may_have_masks(capture: Path, made: Path, masks: str) -> bool:
    """Whether photographs, or a video's frames that are yet to be chosen, can have masks."""
    if not is_video(capture):
        return bool(source_masks(capture, masks))
    return masks not in (FOUND, NONE) or (masks == FOUND and (made / MASKS).is_dir())
