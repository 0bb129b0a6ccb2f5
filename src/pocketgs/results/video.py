"""Writing rendered frames as an .mp4 file."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import cv2
import numpy as np

from pocketgs.capture.video_file import video_codec
from pocketgs.errors import PocketGSError
from pocketgs.files.atomic_file import replacing

CODEC, DECODED_AS = "mp4v", "FMP4"
"""MPEG-4 Visual, as OpenCV and as FFmpeg name it."""

SLOWEST, FASTEST = 0.1, 1000.0
"""Range of frame rates; OpenCV hangs at an infinite one."""


def write_video(path: str | Path, frames: Iterable[np.ndarray], fps: float = 30.0) -> None:
    """Encode frames as MPEG-4 video with OpenCV, one at a time.

    The file is written atomically.

    Args:
        path: ending in .mp4.
        frames: (H, W, 3) uint8 RGB, all of one size. An odd row or column at the bottom or right is cropped, since the
            codec needs even sizes.
        fps: frames per second.

    Raises:
        PocketGSError: the path does not end in .mp4 or cannot be written, there are no frames, or one is not an RGB
            image of the first one's size.
    """
    path = Path(path)
    if path.suffix.lower() != ".mp4":
        raise PocketGSError(f"{path}: a video's name ends in .mp4, found {path.suffix or 'no suffix'}")
    if not SLOWEST <= fps <= FASTEST:
        raise PocketGSError(f"fps: found {fps}, expected {SLOWEST} to {FASTEST}")
    if not path.parent.is_dir():
        raise PocketGSError(f"{path}: there is no folder {path.parent}")
    with replacing(path) as partial:
        count, size = _encode(partial, frames, fps, path)
        _check(partial, count, size, path)


def is_written_video(path: Path) -> bool:
    """Whether a file is a video as `write_video` writes them; cameras use other codecs.

    Raises:
        PocketGSError: it is not a readable video.
    """
    return video_codec(path) == DECODED_AS


def _encode(partial: Path, frames: Iterable[np.ndarray], fps: float, path: Path) -> tuple[int, tuple[int, int]]:
    """Write to `partial`; errors name `path`. Returns the number of frames, and their width and height."""
    writer: cv2.VideoWriter | None = None
    size, count = (0, 0), 0
    try:
        for number, frame in enumerate(frames):
            if frame.ndim != 3 or frame.shape[2] != 3 or frame.dtype != np.uint8 or min(frame.shape[:2]) < 2:
                found = f"{frame.dtype} of shape {frame.shape}"
                raise PocketGSError(f"{path}: frame {number} is {found}, expected uint8 of shape (H, W, 3)")
            frame_size = (frame.shape[1] // 2 * 2, frame.shape[0] // 2 * 2)
            if writer is None:
                size = frame_size
                writer = _open(partial, fps, size, path)
            if frame_size != size:
                raise PocketGSError(f"{path}: frame {number} has size {frame_size}, expected {size} like the first")
            writer.write(cv2.cvtColor(frame[: size[1], : size[0]], cv2.COLOR_RGB2BGR))
            count += 1
    finally:
        if writer is not None:
            writer.release()
    if writer is None:
        raise PocketGSError(f"{path}: no frames to write, expected at least one")
    return count, size


def _check(written: Path, count: int, size: tuple[int, int], path: Path) -> None:
    """Decode the written file: OpenCV reports no error when the disk is full, and leaves a broken file.

    Raises:
        PocketGSError: it is not complete.
    """
    if not _has_all_boxes(written):
        raise PocketGSError(f"{path}: only a part of the video could be written, expected more room; is the disk full?")
    reader = cv2.VideoCapture(str(written))
    decoded = 0
    try:
        while True:
            found, frame = reader.read()
            if not found:
                break
            if frame.shape != (size[1], size[0], 3):
                raise PocketGSError(f"{path}: frame {decoded} was written incorrectly, expected another codec or size")
            decoded += 1
    finally:
        reader.release()
    if decoded != count:
        raise PocketGSError(f"{path}: {decoded} of {count} frames can be read back from what was written, expected all")


def _has_all_boxes(path: Path) -> bool:
    """Whether the boxes of an MP4 file end exactly at its end, and include the one that lists frames.

    Each begins with its size in 4 bytes and its name in 4 more; a size of 1 means that the size is in the next 8 bytes
    (ISO 14496-12, 4.2).
    """
    length, start, names = path.stat().st_size, 0, set()
    with path.open("rb") as file:
        while start < length:
            file.seek(start)
            size, name = int.from_bytes(file.read(4), "big"), file.read(4)
            if size == 1:
                size = int.from_bytes(file.read(8), "big")
            if size < 8:
                return False
            start += size
            names.add(name)
    return start == length and b"moov" in names


def _open(partial: Path, fps: float, size: tuple[int, int], path: Path) -> cv2.VideoWriter:
    writer = cv2.VideoWriter(str(partial), cv2.VideoWriter.fourcc(*CODEC), fps, size)
    if not writer.isOpened():
        raise PocketGSError(f"{path}: OpenCV cannot write MPEG-4 video of {size[0]}x{size[1]} pixels there")
    return writer
