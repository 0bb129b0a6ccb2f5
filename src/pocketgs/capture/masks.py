"""Matching masks to photographs, in the layouts that other programs write."""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import Literal

from pocketgs.capture.decoding.image_file import read_size
from pocketgs.capture.last_numbers import NUMBERLESS, last_number, pair_by_number
from pocketgs.capture.listing import FrameSource, Listing
from pocketgs.capture.named_images import spelling
from pocketgs.errors import PocketGSError
from pocketgs.files.opening import folders_around
from pocketgs.files.paths import list_images

FOUND, NONE = "found", "none"
"""Values of the option `masks` other than a folder: use the capture's own masks, or none."""

OutsideMasks = Literal["unknown", "empty"]

FOLDERS = ("masks", "mask")


def masks_folder(capture: Path, masks: str) -> Path | None:
    """The folder of masks that the user named, inside the capture or elsewhere; None for "found" and "none".

    Raises:
        PocketGSError: there is no such folder.
    """
    if masks in (FOUND, NONE):
        return None
    inside = (place / masks for place in folders_around(capture))
    folder = next((place for place in inside if place.is_dir()), Path(masks))
    if not folder.is_dir():
        searched = "" if folder.is_absolute() else f" in the current folder or in {capture}"
        raise PocketGSError(f"{folder}: no such folder, expected one with masks{searched}")
    return folder


def check_has_masks(path: Path, has_masks: bool) -> None:
    """Refuse a capture without masks where what lies outside them should be empty.

    Raises:
        PocketGSError: it has none.
    """
    if not has_masks:
        raise PocketGSError(f"{path}: has no masks, outside which it could be empty; name their folder with --masks")


def with_masks(listing: Listing, capture: Path, masks: str) -> Listing:
    """Add a mask to each frame of a listing that has one.

    Args:
        listing: the capture.
        capture: its folder.
        masks: a folder, inside the capture or elsewhere; "found" for the masks that the capture states or, if it states
            none, those of a folder `masks` or `mask` beside its images or in the capture; "none" for none.

    Raises:
        PocketGSError: the folder does not exist or holds no mask of a frame, or one mask fits several frames.
    """
    if masks == NONE:
        return replace(listing, frames=[replace(frame, mask_path=None) for frame in listing.frames])
    names = [frame.name for frame in listing.frames]
    folder = masks_folder(capture, masks)
    if folder is not None:
        return _with(listing, _match_all(names, folder), folder)
    if any(frame.mask_path is not None for frame in listing.frames):
        return listing
    for beside in _folders_of_masks(names, capture):
        # The user did not ask for these masks: errors in them must not stop the run.
        try:
            found = _match_all(names, beside)
            if beside.parent not in {_above_folder_of(name, capture) for name in names}:
                _check_shapes(listing.frames, found)
            return _with(listing, found, beside, are_found=True)
        except PocketGSError as error:
            listing = replace(listing, warnings=(*listing.warnings, f"{error}; these masks are not used"))
    return listing


def find_masks(names: Sequence[str], capture: Path, masks: str) -> dict[str, Path]:
    """Masks of photographs without poses, by photograph.

    Args:
        names: the photographs' paths inside the capture.
        capture: its folder.
        masks: as for `with_masks`.

    Raises:
        PocketGSError: as `with_masks`, or one mask of a folder that was not asked for fits several photographs.
    """
    if masks == NONE:
        return {}
    folder = masks_folder(capture, masks)
    if folder is not None:
        return _match_all(names, folder)
    matches = (match_masks(names, beside) for beside in _folders_of_masks(names, capture))
    return next(filter(None, matches), {})


def _folders_of_masks(names: Sequence[str], capture: Path) -> list[Path]:
    """Existing folders of masks: beside the photographs' folder, whatever its name, or else in the capture.

    The masks in a capture may be of the originals, where undistorted copies in another folder are used.
    Photographs of half size, in `images_2`, may have their masks in `masks_2`.

    Args:
        names: the photographs' paths inside the capture.
        capture: its folder.
    """
    folders = {PurePosixPath(name).parent for name in names}
    sizes = sorted({size[0] for folder in folders if (size := re.search(r"_\d+$", folder.name))})
    usual = [f"{name}{size}" for size in (*sizes, "") for name in FOLDERS]
    places = [*sorted({_above_folder_of(name, capture) for name in names}), Path(os.path.normpath(capture))]
    found = (place / name for place in places for name in usual)
    return [folder for folder in dict.fromkeys(found) if folder.is_dir()]


def _above_folder_of(photograph: str, capture: Path) -> Path:
    """The folder that holds a photograph's folder."""
    return Path(os.path.normpath(capture / PurePosixPath(photograph).parent.parent))


def _check_shapes(frames: Sequence[FrameSource], masks: dict[str, Path]) -> None:
    """Refuse masks that are no scaled copies of their photographs: they are of others, such as those not undistorted.

    Raises:
        PocketGSError: one mask is of another shape, or not an image.
    """
    for frame in frames:
        if (mask := masks.get(frame.name)) is None:
            continue
        (width, height), camera = read_size(mask), frame.camera
        if abs(width * camera.height / camera.width - height) > 1:
            raise PocketGSError(
                f"{mask}: mask of {width}x{height} pixels, expected the shape of {frame.name}, "
                f"{camera.width}x{camera.height}: it may be of the photograph before undistortion"
            )


def check_for_video(video: Path, folder: Path) -> None:
    """Refuse a folder whose images cannot be masks of a video's frames, before the frames are extracted.

    Frames get their names only then, so that whether all have a mask is unknown.

    Args:
        video: the video.
        folder: with the masks.

    Raises:
        PocketGSError: no image in the folder has the name of a frame, or all frames' numbers.
    """
    stems = [file.stem for file in _files(folder)]
    are_numbered = bool(stems) and all(last_number(stem) != NUMBERLESS for stem in stems)
    if not are_numbered and not any(re.match(r"frame_\d{6}", stem) for stem in stems):
        raise PocketGSError(
            f"{folder}: holds no mask of a frame of {video}, expected such as frame_000120.png for frame 120, counted "
            "from 0; the frames that are used, and their names, are in the folder images of the posed capture, which a "
            "run without --masks makes"
        )


def match_masks(names: Sequence[str], folder: Path) -> dict[str, Path]:
    """Match the masks in a folder and its sub-folders to photographs; returns them by photograph.

    A mask has its photograph's name with another suffix or, as in COLMAP, with a second one. Sub-folders mirror those
    of the photographs, or there are none. If no name matches, the last number in each name is used, if these all match.

    Args:
        names: the photographs' paths inside the capture.
        folder: with the masks.

    Raises:
        PocketGSError: one mask fits several photographs.
    """
    files = _files(folder)
    by_name: dict[str, Path] = {}
    for file in files:
        name = file.relative_to(folder)
        for key in (name, name.with_suffix("")):
            by_name.setdefault(spelling(key.as_posix()), file)
    found = {name: mask for name in names if (mask := _named(name, by_name)) is not None}
    found = found or pair_by_number(names, files)
    shared = [mask for mask, count in Counter(found.values()).items() if count > 1]
    if shared:
        one, other, *_ = (name for name, mask in found.items() if mask == shared[0])
        raise PocketGSError(f"{shared[0]}: fits both {one} and {other}, expected sub-folders as the images have them")
    return found


def _match_all(names: Sequence[str], folder: Path) -> dict[str, Path]:
    """As `match_masks`, but finding no mask at all is an error."""
    found = match_masks(names, folder)
    if not found:
        example = PurePosixPath(names[0])
        raise PocketGSError(
            f"{folder}: none of its {len(_files(folder))} images is the mask of a frame, expected such as "
            f"{example.name}.png or {example.stem}.png"
        )
    return found


def _named(photograph: str, masks: dict[str, Path]) -> Path | None:
    """The mask of a photograph by its path, or by the longest matching end of its path."""
    parts = PurePosixPath(spelling(photograph)).parts
    for start in range(len(parts)):
        name = PurePosixPath(*parts[start:])
        # `masks` also has each file by its name without the last suffix: NAME.jpg.png is found as NAME.jpg.
        for key in (name.as_posix(), name.with_suffix("").as_posix()):
            if key in masks:
                return masks[key]
    return None


def _files(folder: Path) -> list[Path]:
    """All images in a folder and its sub-folders, sorted."""
    folders = [folder, *(path for path in sorted(folder.rglob("*")) if path.is_dir())]
    return [file for each in folders for file in list_images(each)]


def _with(listing: Listing, found: dict[str, Path], folder: Path, are_found: bool = False) -> Listing:
    frames = [replace(frame, mask_path=found.get(frame.name), mask_is_found=are_found) for frame in listing.frames]
    lacking = [frame.name for frame in frames if frame.mask_path is None]
    warnings = listing.warnings
    if lacking:
        count = f"{len(lacking)} of {len(frames)} frames"
        warnings += (f"{folder}: no masks for {count}, which are used whole, the first {lacking[0]}",)
    return replace(listing, frames=frames, warnings=warnings)
