"""Reader of NeRF-Synthetic scenes, rendered by Blender: transforms_train.json and transforms_test.json, RGBA images."""

from __future__ import annotations

from pathlib import Path

from pocketgs.capture.formats.transforms_file import (
    absent_warning,
    check_some_exist,
    held_out_too_warning,
    mask_warning,
    read_frames,
)
from pocketgs.capture.listing import FrameSource, Listing
from pocketgs.errors import PocketGSError
from pocketgs.files.json_fields import read_json

FORMAT = "blender"
LOOKED_FOR = "transforms_train.json"
WHITE = (1.0, 1.0, 1.0)


def recognises(path: Path) -> bool:
    """Whether the folder holds a transforms_train.json."""
    return (path / "transforms_train.json").is_file()


def read(path: Path, images: str | None = None) -> Listing:
    """Read the training and test frames; transforms_val.json is ignored.

    Raises:
        PocketGSError: a file is malformed, no training frame has an image, or `images` is given, which the format does
            not support.
    """
    if images is not None:
        raise PocketGSError(f"{path}: images='{images}' given, but blender captures name their images in full")
    train, warnings = _read_split(path, "transforms_train.json")
    if not (path / "transforms_test.json").is_file():
        return Listing(FORMAT, train, background=WHITE, warnings=warnings)
    # The test images may be absent: people leave them out to save space.
    test, more_warnings = _read_split(path, "transforms_test.json", may_be_absent=True)
    held_out = frozenset(frame.name for frame in test)
    both = [frame.name for frame in train if frame.name in held_out]
    warnings += more_warnings + held_out_too_warning(path / "transforms_test.json", both, len(train))
    frames = [frame for frame in train if frame.name not in held_out] + test
    return Listing(FORMAT, frames, held_out=held_out or None, background=WHITE, warnings=warnings)


def _read_split(path: Path, name: str, may_be_absent: bool = False) -> tuple[list[FrameSource], tuple[str, ...]]:
    document = read_json(path / name)
    # Always with the folder: training and test images have the same names.
    frames, warnings = read_frames(document, path, may_have_moved=False)
    if not may_be_absent:
        check_some_exist(frames, document)
    warnings += absent_warning(frames, document) + mask_warning(frames, document)
    return [frame for frame in frames if frame is not None], warnings
