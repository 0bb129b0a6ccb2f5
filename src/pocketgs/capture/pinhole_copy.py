"""A capture that is photographed through lenses, as pinhole cameras would have seen it: for what knows no lens."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

from pocketgs.capture.capture import Capture, Frame
from pocketgs.capture.frame_edits import undistorted
from pocketgs.capture.undistortion import forget_undistortions
from pocketgs.errors import PocketGSError
from pocketgs.system.cores import usable_cores


def has_lenses(capture: Capture) -> bool:
    """Whether a frame was photographed through a lens that has not been undone."""
    return not all(frame.camera.is_pinhole for frame in capture.frames)


def without_lenses(capture: Capture) -> Capture:
    """The capture with every frame undistorted, in memory, at the size that it has there.

    Raises:
        PocketGSError: a lens leaves no usable part of an image.
    """
    with ThreadPoolExecutor(usable_cores()) as pool:
        train, held_out = list(pool.map(_pinhole, capture.train)), list(pool.map(_pinhole, capture.held_out))
    forget_undistortions()
    return replace(capture, train=train, held_out=held_out)


def _pinhole(frame: Frame) -> Frame:
    if frame.camera.is_pinhole:
        return frame
    try:
        return undistorted(frame, frame.camera.lens)
    except PocketGSError as error:
        raise PocketGSError(f"{frame.name}: {error}") from error


def frames_at(originals: list[Frame], posed: list[Frame]) -> list[Frame]:
    """The frames, by name, at the poses of others; those that the others lack are left out."""
    poses = {frame.name: frame.camera.world_to_camera for frame in posed}
    return [
        replace(frame, camera=replace(frame.camera, world_to_camera=poses[frame.name]))
        for frame in originals
        if frame.name in poses
    ]
