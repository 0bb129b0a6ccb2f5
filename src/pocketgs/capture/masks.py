"""Which mask belongs to which photograph, in the layouts that other programs leave masks in."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path, PurePosixPath

from pocketgs.capture.listing import FrameSource, Listing
from pocketgs.capture.paths import IMAGE_SUFFIXES, inside, list_images
from pocketgs.errors import PocketGSError

FOUND, NONE = "found", "none"
"""Values of the option `masks` that name no folder: take what the capture states or has; take none."""

FOLDERS = ("masks", "mask")

NUMBERLESS, MOST_DIGITS = -1, 18


def with_masks(listing: Listing, capture: Path, masks: str) -> Listing:
    """The listing with a mask for each frame that has one.

    Args:
        listing: the capture.
        capture: its folder.
        masks: a folder, inside the capture or anywhere; "found" for the masks that the capture states or, if it states
            none, those of a folder `masks` or `mask` beside its images or in the capture; "none" for none.

    Raises:
        PocketGSError: the folder does not exist or holds no mask of a frame, or one mask fits several frames.
    """
    if masks == NONE:
        return replace(listing, frames=[replace(frame, mask_path=None) for frame in listing.frames])
    if masks != FOUND:
        folder = capture / masks if (capture / masks).is_dir() else Path(masks)
        if not folder.is_dir():
            raise PocketGSError(f"{folder}: no such folder, expected one with masks")
        found = match(listing.frames, folder)
        if not found:
            raise PocketGSError(
                f"{folder}: none of its {len(_files(folder))} images is the mask of a frame such as "
                f"{listing.frames[0].name}, expected {PurePosixPath(listing.frames[0].name).name}.png or the same stem"
            )
        return _with(listing, found, folder)
    if any(frame.mask_path is not None for frame in listing.frames):
        return listing
    return _with_found(listing, capture)


def _with_found(listing: Listing, capture: Path) -> Listing:
    """The listing with the masks of the first folder that has some; folders nobody asked for are no reason to fail."""
    for folder in _candidates(listing.frames, capture):
        try:
            found = match(listing.frames, folder)
            problem = f"{folder}: fits no frame"
        except PocketGSError as error:
            found, problem = {}, str(error)
        if found:
            return _with(listing, found, folder)
        listing = replace(listing, warnings=(*listing.warnings, f"{problem}; its masks are not used"))
    return listing


def match(frames: Sequence[FrameSource], folder: Path) -> dict[str, Path]:
    """The masks in a folder and its sub-folders, by the name of the frame that each belongs to.

    A mask is named as its photograph, with another suffix or, as COLMAP has it, with one more; in sub-folders as the
    photographs or all in one place. Where no name agrees but the numbers in all names do, numbers decide.

    Raises:
        PocketGSError: one mask fits several frames.
    """
    files = _files(folder)
    by_name: dict[str, Path] = {}
    for file in files:
        name = file.relative_to(folder).as_posix()
        for key in (name, PurePosixPath(name).with_suffix("").as_posix()):
            by_name.setdefault(key.casefold(), file)
    found = {frame.name: mask for frame in frames if (mask := _named(frame.name, by_name)) is not None}
    found = found or _numbered(frames, files)
    shared = [mask for mask, count in Counter(found.values()).items() if count > 1]
    if shared:
        names = [name for name, mask in found.items() if mask == shared[0]]
        raise PocketGSError(
            f"{shared[0]}: fits both {names[0]} and {names[1]}, expected masks in sub-folders as the images"
        )
    return found


def _named(frame: str, masks: dict[str, Path]) -> Path | None:
    """The mask of a frame by its path, or by as much of its end as there is a mask of."""
    parts = PurePosixPath(frame.casefold()).parts
    for start in range(len(parts)):
        name = PurePosixPath(*parts[start:])
        # `masks` has each file's name without its last suffix too: NAME.jpg.png is found as NAME.jpg.
        for key in (name.as_posix(), name.with_suffix("").as_posix()):
            if key in masks:
                return masks[key]
    return None


def _numbered(frames: Sequence[FrameSource], masks: Sequence[Path]) -> dict[str, Path]:
    """Masks by the numbers that end their names; none unless they are those of the photographs, each once."""
    numbers = {frame.name: _number(PurePosixPath(frame.name).stem) for frame in frames}
    by_number = {_number(mask.stem): mask for mask in masks}
    agree = sorted(numbers.values()) == sorted(_number(mask.stem) for mask in masks)
    if not agree or NUMBERLESS in by_number or len(by_number) < len(masks):
        return {}
    return {name: by_number[number] for name, number in numbers.items()}


def _number(stem: str) -> int:
    """The last number in a name."""
    digits = re.findall(r"\d+", stem)
    return int(digits[-1][-MOST_DIGITS:]) if digits else NUMBERLESS


def _candidates(frames: Iterable[FrameSource], capture: Path) -> list[Path]:
    """The folders of masks there are: beside the photographs' own folder, whatever that is called, or in the capture.

    Beside photographs of half the size, `images_2`, masks may be in `masks_2`.
    """
    names = {PurePosixPath(frame.name) for frame in frames}
    top = {name.parts[0] for name in names if len(name.parts) > 1}
    sizes = {match[0] for folder in top if (match := re.search(r"_\d+$", folder))}
    places = [f"{name}{size}" for size in (*sizes, "") for name in FOLDERS]
    beside = {name.parent.parent.as_posix() for name in names}
    found = [inside(capture, f"{parent}/{name}", "masks") for parent in (".", *sorted(beside)) for name in places]
    return [folder for folder in dict.fromkeys(found) if folder.is_dir()]


def _files(folder: Path) -> list[Path]:
    """The images in a folder and its sub-folders, sorted."""
    folders = [folder, *(path for path in sorted(folder.rglob("*")) if path.is_dir())]
    return [file for each in folders for file in list_images(each) if file.suffix.lower() in IMAGE_SUFFIXES]


def _with(listing: Listing, found: dict[str, Path], folder: Path) -> Listing:
    frames = [replace(frame, mask_path=found.get(frame.name)) for frame in listing.frames]
    lacking = [frame.name for frame in frames if frame.mask_path is None]
    warnings = listing.warnings
    if lacking:
        count = f"{len(lacking)} of {len(frames)} frames"
        warnings += (f"{folder}: no masks for {count}, which are used whole, the first {lacking[0]}",)
    return replace(listing, frames=frames, warnings=warnings)
