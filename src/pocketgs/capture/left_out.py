"""Warnings about what was left out of a capture as its frames were loaded."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from pocketgs.capture.capture import Frame
from pocketgs.capture.decoding.mask_file import read_mask
from pocketgs.capture.frame_parts import reliable_depth
from pocketgs.capture.listing import FrameSource
from pocketgs.errors import PocketGSError
from pocketgs.files.opening import reading_inside


def damaged_warning(damaged: Mapping[str, PocketGSError], of: int) -> tuple[str, ...]:
    """One warning that counts the photographs that cannot be decoded, or none.

    Args:
        damaged: errors by frame name.
        of: number of frames.
    """
    if not damaged:
        return ()
    found = f"{len(damaged)} of {of} photographs cannot be decoded, the first {min(damaged)}"
    return (f"{found}: these frames are left out ({damaged[min(damaged)]}); if they are damaged, copy them again",)


def masked_out_warning(loaded: Sequence[Frame], usable: Sequence[Frame]) -> tuple[str, ...]:
    """One warning that counts the frames whose masks exclude every pixel, or none."""
    if len(usable) == len(loaded):
        return ()
    left_out = {frame.name for frame in loaded} - {frame.name for frame in usable}
    found = f"the masks of {len(left_out)} of {len(loaded)} frames leave no pixel, the first {min(left_out)}"
    return (f"{found}: these frames are left out; masks are white where pixels are to be used",)


def mask_warnings(listed: Sequence[FrameSource], loaded: Sequence[Frame], folder: Path | None) -> tuple[str, ...]:
    """Warnings that count the masks that were found and cannot be used; arguments as for `depth_warnings`."""
    with_mask = {frame.name for frame in loaded if frame.mask is not None}
    lacking = [source for source in listed if source.mask_path is not None and source.name not in with_mask]
    return _warnings("masks", "the frames are used whole", lacking, _why_mask_is_unreadable, folder)


def depth_warnings(listed: Sequence[FrameSource], loaded: Sequence[Frame], folder: Path | None) -> tuple[str, ...]:
    """Warnings that count the depth maps that were left out: those not readable, and those of another shape.

    Args:
        listed: the frames as listed.
        loaded: the same frames, loaded.
        folder: that all files must lie in, or None.
    """
    with_depth = {frame.name for frame in loaded if frame.depth is not None}
    lacking = [source for source in listed if source.depth_path is not None and source.name not in with_depth]
    return _warnings("depth maps", "they are left out", lacking, _why_depth_is_unreadable, folder)


def _warnings(
    kind: str,
    then: str,
    lacking: Sequence[FrameSource],
    why_unreadable: Callable[[FrameSource], str | None],
    folder: Path | None,
) -> tuple[str, ...]:
    with reading_inside(folder):
        reasons = {source.name: why_unreadable(source) for source in lacking}
    unreadable = {name: reason for name, reason in reasons.items() if reason is not None}
    misshapen = [name for name in reasons if name not in unreadable]
    warnings = []
    if unreadable:
        name, reason = next(iter(unreadable.items()))
        found = f"the {kind} of {len(unreadable)} frames cannot be used, the first of {name}"
        warnings.append(f"{found}: {then} ({reason})")
    if misshapen:
        found = f"the {kind} of {len(misshapen)} frames have not the shape of their photographs"
        warnings.append(f"{found}, the first of {misshapen[0]}: {then}")
    return tuple(warnings)


def _why_mask_is_unreadable(source: FrameSource) -> str | None:
    assert source.mask_path is not None
    try:
        read_mask(source.mask_path)
    except PocketGSError as error:
        return str(error)
    return None


def _why_depth_is_unreadable(source: FrameSource) -> str | None:
    try:
        reliable_depth(source)
    except PocketGSError as error:
        return str(error)
    return None
