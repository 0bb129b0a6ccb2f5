"""Opening a capture: recognise its format, read it, split it, load its frames."""

from __future__ import annotations

import os
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import Protocol

from pocketgs.capture.capture import Capture
from pocketgs.capture.decoding.video_file import VIDEO_SUFFIXES
from pocketgs.capture.formats import blender, colmap, llff, nerfstudio, polycam, record3d, scanner_app, stray_scanner
from pocketgs.capture.hold_out import FEWEST_TO_HOLD_OUT, choose_held_out
from pocketgs.capture.listed import ListedCapture
from pocketgs.capture.listing import Listing
from pocketgs.capture.loading import Preparation
from pocketgs.capture.masks import check_has_masks, masks_folder, with_masks
from pocketgs.capture.options import CaptureOptions
from pocketgs.capture.origin import near_origin
from pocketgs.capture.unposed import USUAL_FOLDER, find_photographs_in, holds_photographs, only_video
from pocketgs.capture.unrecognised import MAX_NAMES, what_is_there
from pocketgs.errors import PocketGSError, listed
from pocketgs.files.opening import folder_of, folders_around, reading_inside
from pocketgs.files.paths import IMAGE_SUFFIXES, relative_name


class Reader(Protocol):
    """The interface of a reader module."""

    FORMAT: str
    LOOKED_FOR: str

    def recognises(self, path: Path) -> bool:
        """Whether a file or folder looks like this format."""

    def read(self, path: Path, images: str | None = None) -> Listing:
        """List the capture's frames without loading them."""


# The first reader that recognises a folder reads it. Where a folder fits several formats, a phone app's own data says
# more than what was converted from it, a blender split more than a single transforms.json, and COLMAP's full
# calibration more than poses_bounds.npy.
READERS: tuple[Reader, ...] = (stray_scanner, record3d, scanner_app, polycam, blender, nerfstudio, colmap, llff)


def open_capture(path: str | Path, options: CaptureOptions | None = None, **changes: object) -> Capture:
    """Read a capture of any supported format into memory.

    Example:
        >>> capture = open_capture("fern", images="images_8")
        >>> len(capture.train), len(capture.held_out)
        (17, 3)

    Args:
        path: the capture's folder, or its transforms.json or .r3d file.
        options: None for the defaults.
        **changes: single options by name, which override those in `options`.

    Raises:
        PocketGSError: the capture or an option is not usable; the message names the file, what was found and what was
            expected.
    """
    return list_capture(path, options, **changes).load()


def list_capture(path: str | Path, options: CaptureOptions | None = None, **changes: object) -> ListedCapture:
    """List a capture without decoding photographs; arguments as in `open_capture`.

    Raises:
        PocketGSError: the capture or an option is not usable.
    """
    path, options = Path(path), replace(options or CaptureOptions(), **changes)  # type: ignore[arg-type]
    listing = read_listing(path, options.images)
    place = located(path)
    folder = place if place.is_dir() else place.parent
    with reading_inside(folder_of(path)):
        listing = with_masks(listing, folder, options.masks)
        masks = masks_folder(folder, options.masks)
    if options.outside_masks == "empty":
        check_has_masks(path, any(frame.mask_path is not None for frame in listing.frames))
    held_out_names, split = choose_held_out(listing, options.hold_out)
    count = len(listing.frames)
    if all(frame.name in held_out_names for frame in listing.frames):
        expected = "expected one to train on; --hold-out 0 trains on all"
        raise PocketGSError(f"{path}: all of its {count} frames are held out, {expected}")
    if count < FEWEST_TO_HOLD_OUT and options.hold_out and not held_out_names:
        unmeasured = f"{path}: fewer than {FEWEST_TO_HOLD_OUT} frames: none is held out to measure quality on"
        listing = replace(listing, warnings=(*listing.warnings, unmeasured))
    preparation = Preparation(
        options.background or listing.background,
        options.lens,
        options.downscale or 1.0,
        options.max_size,
        folder=folder_of(path),
        masks=masks,
        outside_masks=options.outside_masks,
    )
    return ListedCapture(
        capture_name(path),
        path,
        listing,
        held_out_names,
        split,
        preparation,
        size_is_given=options.downscale is not None,
        background_is_given=options.background is not None,
    )


def read_listing(path: Path, images: str | None = None) -> Listing:
    """Recognise a capture's format and read its files, cameras and lenses, without decoding images.

    Raises:
        PocketGSError: no format is recognised, the capture is malformed, or it has no frames.
    """
    try:
        place = located(path)
        with reading_inside(folder_of(path)):
            listing = _reader_for(place).read(place, _relative(images, folder_of(place)))
    except OSError as error:  # such as a folder without permission
        raise PocketGSError(f"{path}: cannot be read ({error})") from error
    if place != path:
        found = f"{path}: not a capture itself, using the one in it, {relative_name(place, path)}"
        listing = replace(listing, warnings=(found, *listing.warnings))
    names = [frame.name for frame in listing.frames]
    if not names:
        raise PocketGSError(f"{path}: lists no frame, expected at least one")
    if len(set(names)) < len(names):
        repeated = next(name for name in names if names.count(name) > 1)
        raise PocketGSError(f"{path}: lists the image {repeated} more than once, expected each once")
    return near_origin(listing)


def _relative(images: str | None, folder: Path | None) -> str | None:
    """The option as a path from the capture's own folder, which readers expect.

    It may also be a path from a folder around that, up to the one that is being read, or an absolute one inside this.

    Raises:
        PocketGSError: it is absolute and leads elsewhere.
    """
    if images is None or folder is None:
        return images
    places = folders_around(folder)
    if not Path(images).is_absolute():
        found = (place / images for place in places if (place / images).is_dir())
        return next((relative_name(place, folder) for place in found), images)
    given = places[-1]
    stated, leads_to = Path(os.path.normpath(images)), Path(images).resolve()
    for named, around, own in (
        (stated, given.absolute(), folder.absolute()),
        (leads_to, given.resolve(), folder.resolve()),
    ):
        if named.is_relative_to(around):
            return relative_name(named, own)
    expected = "expected the option images to name a folder inside it, such as images_8"
    raise PocketGSError(f"{images}: lies outside the capture's folder {given}, {expected}")


def holds_capture(path: Path) -> bool:
    """Whether the path is a capture of a supported format."""
    return any(reader.recognises(path) for reader in READERS)


def lacks_poses(path: Path) -> bool:
    """Whether the path is a video or a folder of photographs, and not a capture of a supported format.

    Raises:
        PocketGSError: it is a folder that holds several captures.
    """
    return holds_photographs(path) and not holds_capture(located(path))


def video_of(path: Path) -> Path:
    """The path itself, or, if it is a folder without photographs and no capture, its `only_video`.

    Raises:
        PocketGSError: it is a folder that holds a video and several captures.
        OSError: a folder cannot be read.
    """
    video = only_video(path)
    return path if video is None or holds_capture(located(path)) else video


def located(path: Path) -> Path:
    """The path itself, or, if it is not a capture, the only folder or .r3d file in it that is one.

    Unpacking an archive often creates a folder that contains only the capture's folder. It may lie a level deeper too.
    Pictures beside it are previews or notes, unless they are as many as its own.

    Raises:
        PocketGSError: there are several.
        OSError: a folder cannot be read.
    """
    if not path.is_dir() or holds_capture(path):
        return path
    beside = len(find_photographs_in(path))
    try:
        captures = _captures_in(path)
        if beside and not any(_has_more_than(beside, capture) for capture in captures):
            return path
    except OSError:
        if beside:  # these can be read
            return path
        raise
    if len(captures) > 1 and not find_photographs_in(path / USUAL_FOLDER):
        names = listed([relative_name(found, path) for found in captures], MAX_NAMES)
        raise PocketGSError(f"{path}: holds {len(captures)} captures, {names}: name one of them")
    return captures[0] if len(captures) == 1 else path


def _captures_in(path: Path) -> list[Path]:
    """The captures in a folder, or else those a level deeper."""
    inner = _inside(path)
    return list(filter(holds_capture, inner)) or list(filter(holds_capture, chain(*map(_inside, inner))))


def _has_more_than(number: int, capture: Path) -> bool:
    """Whether a folder of a capture holds more pictures, or none does: its photographs are in a video or elsewhere."""
    inner = _inside(capture)
    most = max(len(find_photographs_in(folder)) for folder in (capture, *inner, *chain(*map(_inside, inner))))
    return most == 0 or most > number


def _inside(path: Path) -> list[Path]:
    """The folders and .r3d files in a folder, sorted; of a file none."""
    entries = sorted(path.iterdir()) if path.is_dir() else []
    visible = (entry for entry in entries if not entry.name.startswith("."))
    return [entry for entry in visible if entry.is_dir() or record3d.is_archive(entry)]


def _reader_for(path: Path) -> Reader:
    if not path.exists():
        raise PocketGSError(f"{path}: no such file or folder, expected a capture")
    for reader in READERS:
        if reader.recognises(path):
            return reader
    if holds_photographs(path) or only_video(path):
        raise PocketGSError(f"{path}: photographs without poses, expected a capture; run pocketgs pose to make one")
    if found := what_is_there(path, holds_capture):
        raise PocketGSError(f"{path}: not a capture of a supported format: {found}")
    raise PocketGSError(
        f"{path}: not a capture of a supported format. Looked for photographs "
        f"({', '.join(sorted(IMAGE_SUFFIXES))}); a video ({', '.join(sorted(VIDEO_SUFFIXES))}); "
        + "; ".join(f"{reader.FORMAT}: {reader.LOOKED_FOR}" for reader in READERS)
    )


def capture_name(path: Path) -> str:
    """The name of a capture: of its folder, or of its file (a video, a .r3d file) without the suffix."""
    resolved = path.resolve()
    if is_transforms_file(resolved):
        return resolved.parent.name or "capture"
    return (resolved.stem if resolved.is_file() else resolved.name) or "capture"


def is_transforms_file(path: Path) -> bool:
    """Whether a capture is given by its transforms.json, which stands for the folder that it lies in."""
    return path.suffix.lower() == ".json" and path.is_file()
