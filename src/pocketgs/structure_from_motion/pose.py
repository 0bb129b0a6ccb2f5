"""From photographs or a video to a capture with poses."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from pocketgs.atomic_folder import replacing_folder
from pocketgs.capture.image_file import read_size
from pocketgs.capture.open import read_listing
from pocketgs.capture.unposed import is_video
from pocketgs.errors import PocketGSError
from pocketgs.structure_from_motion.folder import (
    IMAGES,
    MODEL,
    RECORD,
    check_replaceable,
    read_record,
)
from pocketgs.structure_from_motion.images import gather, names_by_size, source_files
from pocketgs.structure_from_motion.options import PoseOptions
from pocketgs.structure_from_motion.process import check_installed, run_colmap, threads_that_fit

# All pairs of 60 photographs are 1770; beyond that only neighbours by name are matched, and a few far ones.
MOST_FOR_ALL_PAIRS = 60
STAGES = ("frames", "features", "matching", "mapping")
ADVICE = "expected sharp, textured views that overlap by two thirds, taken from places that differ"


@dataclass(frozen=True)
class Posed:
    """What structure from motion made.

    Attributes:
        folder: a capture in COLMAP's layout.
        frames: images that were tried.
        registered: images whose pose was found.
        points: in the sparse cloud.
        reprojection_error: mean, in pixels.
    """

    folder: Path
    frames: int
    registered: int
    points: int
    reprojection_error: float


def pose(
    images_or_video: str | Path,
    output: str | Path,
    options: PoseOptions | None = None,
    *,
    on_stage: Callable[[str], None] = lambda stage: None,
    on_warning: Callable[[str], None] = lambda warning: None,
) -> Posed:
    """Find the poses of photographs or of a video's frames, and write a capture that `open_capture` reads.

    The same input, options and version of pycolmap give the same poses on the same machine, on any number of threads.

    Args:
        images_or_video: a folder with photographs, directly or in a folder `images`, or a video file.
        output: folder for the capture: `images/`, `sparse/0/` and `posed.json`. An earlier one stays until the new one
            is complete.
        options: how; all at their defaults if None.
        on_stage: called with one of `STAGES` when it begins.
        on_warning: called with what the user should know, in words.

    Raises:
        PocketGSError: pycolmap is missing, the input or the output cannot be used, or no poses were found.
    """
    source, output, options = Path(images_or_video), Path(output), options or PoseOptions()
    check_installed()
    made_from = _made_from(source, options)
    check_replaceable(output)
    try:
        with replacing_folder(output) as (staging, workspace):
            on_stage("frames")
            gather(source, staging / IMAGES, options.most_frames)
            groups = names_by_size(staging / IMAGES)
            job = _job(staging, workspace, groups, is_video(source), options)
            outcome = run_colmap("colmap", job, workspace / "log.txt", on_stage)
            frames, registered = sum(map(len, groups)), int(outcome["registered"])
            if registered == 0:
                raise PocketGSError(_nothing_registered(source, frames, outcome))
            # Its writer says nothing of a full disk.
            if len(read_listing(staging).frames) != registered:
                raise PocketGSError(f"{output}: only a part of the poses could be written; is the disk full?")
            record = {**made_from, "frames": frames, **outcome}
            (staging / RECORD).write_text(json.dumps(record, indent=2) + "\n", encoding="utf-8")
    except OSError as error:
        raise PocketGSError(f"{output.resolve()}: cannot be written ({error.strerror or error})") from error
    if registered < frames:
        on_warning(f"poses of {registered} of {frames} images were found; the others are left out")
    return Posed(output, frames, registered, int(outcome["points"]), float(outcome["reprojection_error"]))


def posed(
    images_or_video: str | Path,
    folder: str | Path,
    options: PoseOptions | None = None,
    *,
    on_stage: Callable[[str], None] = lambda stage: None,
    on_warning: Callable[[str], None] = lambda warning: None,
) -> Path:
    """The folder with the posed capture of some photographs or a video, made now unless that has been done before.

    It is used again if it was made with the same options from files of the same names, sizes and times of change.

    Args:
        images_or_video: as for `pose`.
        folder: for the capture, as `output` of `pose`.
        options: as for `pose`.
        on_stage: as for `pose`.
        on_warning: as for `pose`.

    Raises:
        PocketGSError: as `pose`.
    """
    made_from = _made_from(Path(images_or_video), options or PoseOptions())
    record = read_record(Path(folder)) or {}
    if not (made_from.items() <= record.items() and (Path(folder) / MODEL).is_dir()):
        pose(images_or_video, folder, options, on_stage=on_stage, on_warning=on_warning)
    return Path(folder)


def _made_from(source: Path, options: PoseOptions) -> dict[str, Any]:
    """What poses depend on, as it stands in the record."""
    stats = {path.name: path.stat() for path in source_files(source)}
    files = [[name, stat.st_size, stat.st_mtime_ns] for name, stat in stats.items()]
    return {"files": files, "options": asdict(options)}


def _job(
    staging: Path, workspace: Path, groups: list[list[str]], from_video: bool, options: PoseOptions
) -> dict[str, Any]:
    images, model = staging / IMAGES, staging / MODEL / "0"
    model.mkdir(parents=True)
    width, height = read_size(images / groups[0][0])
    reduction = max(1.0, max(width, height) / options.max_size)
    return {
        "images": str(images),
        "model": str(model),
        "database": str(workspace / "features.db"),
        "groups": groups,
        "ordered": from_video or sum(map(len, groups)) > MOST_FOR_ALL_PAIRS,
        "camera_model": options.camera_model,
        "max_size": options.max_size,
        "seed": options.seed,
        "threads": threads_that_fit(int(width * height / reduction**2)),
    }


def _nothing_registered(source: Path, frames: int, outcome: dict[str, Any]) -> str:
    found = f"{outcome['features'] // frames:,} features an image, {outcome['matched_pairs']} pairs that match"
    return f"{source}: no poses found for {frames} images ({found}), {ADVICE}"
