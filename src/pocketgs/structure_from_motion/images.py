"""Gathering the input images of structure from motion in one folder."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path

from PIL import Image

from pocketgs.capture.decoding.image_file import ImageHeader, UndecodableImageError, read_header
from pocketgs.capture.decoding.video_file import read_frames, sharpest_frames
from pocketgs.capture.masks import FOUND, NONE, find_masks
from pocketgs.capture.photograph_copy import names_of_copies, place_masks, place_photograph
from pocketgs.capture.unposed import find_photographs, is_video, left_out_formats
from pocketgs.capture.unrecognised import what_is_there
from pocketgs.errors import PocketGSError, counted
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
        count = counted(len(photographs), "photograph", "photographs")
        expected = f"expected a video or a folder with at least {FEWEST} ({kinds})"
        raise PocketGSError(f"{source}: {count}{found and '; '}{found}, {expected}")
    return photographs


def headers_of(photographs: Iterable[Path]) -> dict[Path, ImageHeader]:
    """The headers of photographs, without those that have none because they are damaged."""
    headers = {}
    for photograph in photographs:
        with suppress(UndecodableImageError):
            headers[photograph] = read_header(photograph)
    return headers


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
) -> list[str]:
    """Copy a video's sharpest frames, or the photographs, to a new folder; the originals are not changed.

    Photographs are stored upright, see `place_photograph`; their masks go to `MASKS` beside the new folder.

    Args:
        source: the video, or the folder with photographs.
        folder: to create.
        options: the maximum number of frames of a video, and which masks to use.
        threads: number of threads.
        on_count: called with the number of images done.
        on_warning: called if masks that nobody named cannot be decoded, a video ends early, or images are left out
            that are other formats of photographs.

    Returns:
        Names of the photographs that are left out because they cannot be decoded. Those that are copied without being
        decoded may be damaged too.

    Raises:
        PocketGSError: a mask that was named cannot be decoded, or there are too few images.
    """
    files = source_files(source)
    folder.mkdir()
    if is_video(source):
        _extract(source, folder, options.most_frames, on_count, on_warning)
        return []
    for warning in left_out_formats(files):
        on_warning(warning)
    names = names_of_copies(list(headers_of(files)))
    whole = each(list(names), lambda path: _is_placed(path, folder / names[path]), threads, on_count)
    placed = {path for path, is_whole in zip(names, whole, strict=True) if is_whole}
    of_all = source_masks(source, options.masks)
    masks, unreadable = {path: mask for path, mask in of_all.items() if path in placed}, list[PocketGSError]()
    place_masks(masks, names, folder.parent / MASKS, unreadable.append if options.masks == FOUND else None)
    if unreadable:
        on_warning(f"{len(unreadable)} of {len(masks)} masks cannot be used, the first is left out: {unreadable[0]}")
    return [path.name for path in files if path not in placed]


def _is_placed(photograph: Path, target: Path) -> bool:
    """Copy a photograph, and tell whether it could be decoded where that takes decoding."""
    try:
        place_photograph(photograph, target)
    except UndecodableImageError:
        return False
    return True


def _extract(video: Path, folder: Path, most_frames: int, on_count: Count, on_warning: Callable[[str], None]) -> None:
    chosen = sharpest_frames(video, most_frames, on_warning)
    if len(chosen) < FEWEST:
        raise PocketGSError(f"{video}: {len(chosen)} frames, expected at least {FEWEST}")
    for done, (index, frame) in enumerate(read_frames(video, chosen), start=1):
        Image.fromarray(frame).save(folder / f"frame_{index:06d}.jpg", quality=JPEG_QUALITY, subsampling=0)
        on_count(done, len(chosen))
