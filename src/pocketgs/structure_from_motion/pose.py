"""Making a posed capture from photographs or a video."""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from pocketgs.capture.open import read_listing, video_of
from pocketgs.capture.unposed import POSED_RECORD, is_video
from pocketgs.capture.unrecognised import unread_pictures
from pocketgs.errors import PocketGSError, counted, listed
from pocketgs.files.atomic_folder import replacing_folder
from pocketgs.files.manifest import files_below
from pocketgs.files.written_files import WRITTEN
from pocketgs.structure_from_motion.attempts import place_all
from pocketgs.structure_from_motion.colmap.mapping_job import MappingOutcome
from pocketgs.structure_from_motion.folder import IMAGES, MASKS, MODEL, check_replaceable, is_whole, read_record
from pocketgs.structure_from_motion.images import FEWEST, gather, headers_of, source_files, source_masks
from pocketgs.structure_from_motion.options import PoseOptions
from pocketgs.structure_from_motion.photographs import Photograph, read_photographs
from pocketgs.structure_from_motion.process import check_installed, threads_that_fit
from pocketgs.structure_from_motion.work import Count

STAGES = ("frames", "features", "matching", "verification", "mapping")
ADVICE = (
    "take sharp photographs of textured surfaces in good light, from different positions, such that each shows two "
    "thirds of the previous one"
)
UNDETERMINED_LENS = (
    "the photographs do not determine the lens: the focal length is EXIF's or a guess, and depths may be coarse; for a "
    "scene that can be seen from elsewhere too, walk around what you photograph"
)
COPY_AGAIN = "If they are damaged, copy them from the camera again"
MAX_NAMES = 12


@dataclass(frozen=True)
class PoseResult:
    """The result of structure from motion.

    Attributes:
        folder: a capture in COLMAP's layout.
        frames: number of input images.
        registered: number of images with a pose.
        points: number of points in the sparse cloud.
        reprojection_error: mean, in pixels.
        metric: whether lengths are metres, from the photographs' GPS positions.
    """

    folder: Path
    frames: int
    registered: int
    points: int
    reprojection_error: float
    metric: bool


def pose(
    images_or_video: str | Path,
    output: str | Path,
    options: PoseOptions | None = None,
    *,
    on_stage: Callable[[str], None] = lambda stage: None,
    on_count: Count = lambda done, of: None,
    on_warning: Callable[[str], None] = lambda warning: None,
) -> PoseResult:
    """Find the poses of photographs or of a video's frames, and write a capture that `open_capture` reads.

    The capture's world is upright, with y down, and centred on the subject. If photographs have GPS positions that are
    spread far enough, it is in metres, x to the east and z to the north.

    The same input, options and version of pycolmap give the same poses on the same machine, on any number of threads.

    Args:
        images_or_video: a folder with photographs, directly or in a folder `images`; a video file, or a folder with
            nothing but one.
        output: folder for the capture: `images/`, `sparse/0/`, `posed.json`, and `masks/` if photographs have masks. An
            earlier one is kept until the new one is complete, and then deleted; one with files of yours is refused.
        options: None for the defaults.
        on_stage: called with one of `STAGES` when it begins; the last three may come more than once.
        on_count: called with the number of images or pairs of the stage that are done, and their total.
        on_warning: called with warnings for the user.

    Raises:
        PocketGSError: pycolmap is missing, the input or the output cannot be used, or no poses were found.
    """
    source, output, options = video_of(Path(images_or_video)), Path(output), options or PoseOptions()
    check_installed()
    made_from = _made_from(source, options)
    if not is_video(source) and (unread := unread_pictures(source_files(source)[0].parent)):
        on_warning(f"{source}: {unread}")
    check_replaceable(output)
    try:
        with replacing_folder(output) as (staging, workspace):
            photographs, damaged = _gather_photographs(
                source, staging, workspace, options, on_stage, on_count, on_warning
            )
            outcome = _find_poses(source, photographs, staging, workspace, options, on_stage, on_count)
            unplaced = sorted({photograph.name for photograph in photographs} - set(outcome["placed"]))
            read_listing(staging)  # COLMAP may not report that the disk is full
            counts = {
                "frames": len(photographs),
                "damaged": damaged,
                "unplaced": unplaced,
                "features": _mean_features(photographs),
            }
            _write_record(staging, {**made_from, **outcome, **counts})
    except OSError as error:
        raise PocketGSError(f"{output.resolve()}: cannot be written ({error.strerror or error})") from error
    if not outcome["lenses_refined"]:
        on_warning(UNDETERMINED_LENS)
    if unplaced:
        on_warning(_lacking(unplaced, len(photographs), outcome.get("other_models", []), outcome["without_parallax"]))
    return PoseResult(
        folder=output,
        frames=len(photographs),
        registered=len(outcome["placed"]),
        points=int(outcome["points"]),
        reprojection_error=float(outcome["reprojection_error"]),
        metric=bool(outcome["metric"]),
    )


def pose_once(
    images_or_video: str | Path,
    folder: str | Path,
    options: PoseOptions | None = None,
    *,
    on_stage: Callable[[str], None] = lambda stage: None,
    on_count: Count = lambda done, of: None,
    on_warning: Callable[[str], None] = lambda warning: None,
) -> Path:
    """The folder with the posed capture of photographs or a video; poses are found only if this was not done before.

    It is reused if it was made with the same options from photographs and masks of the same names, sizes and
    modification times, and its files are still there.

    Args:
        images_or_video: as for `pose`.
        folder: for the capture, as `output` of `pose`.
        options: as for `pose`.
        on_stage: as for `pose`.
        on_count: as for `pose`.
        on_warning: as for `pose`.

    Raises:
        PocketGSError: as `pose`.
    """
    made_from = _made_from(video_of(Path(images_or_video)), options or PoseOptions())
    record = read_record(Path(folder)) or {}
    if not (made_from.items() <= record.items() and is_whole(Path(folder), record)):
        pose(images_or_video, folder, options, on_stage=on_stage, on_count=on_count, on_warning=on_warning)
    return Path(folder)


def _made_from(source: Path, options: PoseOptions) -> dict[str, Any]:
    """Everything that poses depend on, as written to the record."""

    def states(paths: Iterable[Path]) -> list[list[Any]]:
        return [[path.name, path.stat().st_size, path.stat().st_mtime_ns] for path in paths]

    masks = source_masks(source, options.masks).values()
    return {"files": states(source_files(source)), "masks": states(masks), "options": asdict(options)}


def _gather_photographs(
    source: Path,
    staging: Path,
    workspace: Path,
    options: PoseOptions,
    on_stage: Callable[[str], None],
    on_count: Count,
    on_warning: Callable[[str], None],
) -> tuple[list[Photograph], list[str]]:
    """Copy photographs or frames to the new folder and find their features; also the names of those left out.

    Raises:
        PocketGSError: too few can be decoded.
    """
    threads = _threads(source, options)
    on_stage("frames")
    damaged = gather(source, staging / IMAGES, options, threads, on_count, on_warning)
    on_stage("features")
    photographs = read_photographs(staging / IMAGES, staging / MASKS, workspace, options.max_size, threads, on_count)
    gathered = {path.name for path in (staging / IMAGES).iterdir()}
    damaged = sorted({*damaged, *gathered.difference(photograph.name for photograph in photographs)})
    if len(photographs) < FEWEST:
        raise PocketGSError(f"{source}: {_undecodable(damaged)}; expected at least {FEWEST} others. {COPY_AGAIN}")
    if damaged:
        on_warning(f"{source}: {_undecodable(damaged)}; left out. {COPY_AGAIN}")
    return photographs, damaged


def _find_poses(
    source: Path,
    photographs: Sequence[Photograph],
    staging: Path,
    workspace: Path,
    options: PoseOptions,
    on_stage: Callable[[str], None],
    on_count: Count,
) -> MappingOutcome:
    """Find poses and write COLMAP's model to the new folder.

    Raises:
        PocketGSError: no poses were found.
    """
    model = staging / MODEL / "0"
    model.mkdir(parents=True)
    outcome = place_all(photographs, is_video(source), model, workspace, options, on_stage, on_count)
    if not outcome["placed"]:
        found = f"{_mean_features(photographs):,} features per image, {outcome['matched_pairs']} matching pairs"
        why = ", from a camera that stands still" if outcome["stands_still"] else ""
        raise PocketGSError(f"{source}: no poses found for {len(photographs)} images{why} ({found}): {ADVICE}")
    return outcome


def _threads(source: Path, options: PoseOptions) -> int:
    """Number of images that may be decoded and searched for features at the same time."""
    if is_video(source):
        return threads_that_fit(options.max_size**2)
    sizes = ((header.width, header.height) for header in headers_of(source_files(source)).values())
    pixels = (width * height * min(1.0, options.max_size / max(width, height)) ** 2 for width, height in sizes)
    return threads_that_fit(int(max(pixels, default=0)))


def _write_record(staging: Path, record: Mapping[str, Any]) -> None:
    """Write the record of a capture's inputs and result, with the list of all files in its folder."""
    written = [*files_below(staging), POSED_RECORD]
    text = json.dumps({**record, WRITTEN: written}, indent=2) + "\n"
    (staging / POSED_RECORD).write_text(text, encoding="utf-8")


def _mean_features(photographs: Sequence[Photograph]) -> int:
    return sum(photograph.features for photograph in photographs) // len(photographs)


def _undecodable(damaged: list[str]) -> str:
    """What to say of photographs that cannot be decoded."""
    count = counted(len(damaged), "photograph", "photographs")
    return f"{count} cannot be decoded: {listed(damaged, MAX_NAMES)}"


def _lacking(unplaced: list[str], frames: int, other_models: list[int], without_parallax: Collection[str]) -> str:
    """Warning about images without a pose."""
    found = f"poses of {frames - len(unplaced)} of {frames} images were found"
    said = f"{found}; left out: {listed(unplaced, MAX_NAMES)}"
    if other_models:
        parts = ", ".join(map(str, other_models))
        said += f". Parts of {parts} images fit together but not with the rest"
    if 2 * len(set(without_parallax).intersection(unplaced)) > len(unplaced):
        said += (
            ". There the camera only turned, or saw one flat surface, which does not determine its place: walk while "
            "you turn, with other things in view"
        )
    elif other_models:
        said += ". Photographs between the parts would join them"
    if 2 * len(unplaced) > frames:
        said += f". To get more, {ADVICE}"
    return said
