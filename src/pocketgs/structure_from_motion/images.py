"""Gathering the input images of structure from motion in one folder."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from PIL import Image

from pocketgs.capture.masks import FOUND, NONE, find_masks
from pocketgs.capture.photograph_copy import names_of_copies, place_masks, place_photograph
from pocketgs.capture.unposed import find_photographs, is_video
from pocketgs.capture.unrecognised import what_is_there
from pocketgs.capture.video_file import read_frames, sharpest_frames
from pocketgs.errors import PocketGSError
from pocketgs.files.paths import IMAGE_SUFFIXES, relative_name
from pocketgs.structure_from_motion.folder import MASKS
from pocketgs.structure_from_motion.options import PoseOptions
from pocketgs.structure_from_motion.work import Count, each

FEWEST = 3
JPEG_QUALITY = 95


def source_files(source: Path) -> list[Path]:
    """The video, or the photographs sorted by name.

    Raises:
        PocketGSError: there is no such file or folder, or there are too few photographs.
    """
    if is_video(source):
        return [source]
    if not source.exists():
        raise PocketGSError(f"{source}: no such file or folder, expected a video or a folder of photographs")
    photographs = find_photographs(source)
    if len(photographs) < FEWEST:
        kinds, found = ", ".join(sorted(IMAGE_SUFFIXES)), what_is_there(source)
        raise PocketGSError(
            f"{source}: {len(photographs)} photographs{found and '; '}{found}, expected a video or a folder with at "
            f"least {FEWEST} ({kinds})"
        )
    return photographs


def source_masks(source: Path, masks: str) -> dict[Path, Path]:
    """The masks of photographs, by photograph; see `find_masks`.

    Raises:
        PocketGSError: the named masks are not there, or fit several photographs, or the source is a video.
    """
    if is_video(source):
        if masks not in (FOUND, NONE):
            raise PocketGSError(f"{source}: is a video, whose frames have no names yet that masks could have")
        return {}
    photographs = {relative_name(path, source): path for path in source_files(source)}
    return {photographs[name]: mask for name, mask in find_masks(list(photographs), source, masks).items()}


def gather(
    source: Path,
    folder: Path,
    options: PoseOptions,
    threads: int,
    on_count: Count,
    on_warning: Callable[[str], None] = lambda warning: None,
) -> None:
    """Copy a video's sharpest frames, or the photographs, to a new folder; the originals are not changed.

    Photographs are stored upright, see `place_photograph`; their masks go to `MASKS` beside the new folder.

    Args:
        source: the video, or the folder with photographs.
        folder: to create.
        options: the maximum number of frames of a video, and which masks to use.
        threads: number of threads.
        on_count: called with the number of images done.
        on_warning: called if masks that nobody named cannot be decoded.

    Raises:
        PocketGSError: a photograph or a mask that was named cannot be decoded, or there are too few images.
    """
    files = source_files(source)
    folder.mkdir()
    if is_video(source):
        _extract(source, folder, options.most_frames, on_count)
        return
    names = names_of_copies(files)
    each(files, lambda path: place_photograph(path, folder / names[path]), threads, on_count)
    masks, unreadable = source_masks(source, options.masks), list[PocketGSError]()
    place_masks(masks, names, folder.parent / MASKS, unreadable.append if options.masks == FOUND else None)
    if unreadable:
        on_warning(f"{len(unreadable)} of {len(masks)} masks cannot be used, the first is left out: {unreadable[0]}")


def _extract(video: Path, folder: Path, most_frames: int, on_count: Count) -> None:
    chosen = sharpest_frames(video, most_frames)
    if len(chosen) < FEWEST:
        raise PocketGSError(f"{video}: {len(chosen)} frames, expected at least {FEWEST}")
    for done, (index, frame) in enumerate(read_frames(video, chosen), start=1):
        Image.fromarray(frame).save(folder / f"frame_{index:06d}.jpg", quality=JPEG_QUALITY, subsampling=0)
        on_count(done, len(chosen))
