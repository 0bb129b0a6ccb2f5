"""Video decoding. Frames are always decoded in order: seeking is not reliable with every codec."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from pocketgs.capture.sharpness import sharpest_in_windows, sharpness
from pocketgs.errors import PocketGSError
from pocketgs.files.memory_bound import require_memory
from pocketgs.files.opening import checked

VIDEO_SUFFIXES = frozenset({".mp4", ".mov", ".m4v", ".avi", ".mkv", ".webm", ".3gp"})
FFMPEG_QUIET = -8  # AV_LOG_QUIET
DECODING = 24
"""Bytes per pixel while a frame is decoded: its planes, the reference frames, and its colours."""


@dataclass(frozen=True)
class VideoFrame:
    """One frame of a video, counted from 0."""

    path: Path
    index: int

    def __str__(self) -> str:
        return f"{self.path}, frame {self.index}"


def video_size(path: Path, *, upright: bool = True) -> tuple[int, int]:
    """Width and height of a video's first frame in pixels.

    Args:
        path: the video.
        upright: apply the rotation that the file states; otherwise frames are as stored.

    Raises:
        PocketGSError: the file is missing or not a readable video.
    """
    with _opened(path, upright) as video:
        decoded, frame = video.read()
        if not decoded:
            raise PocketGSError(f"{path}: no frame can be decoded, expected a video")
        height, width = frame.shape[:2]
        return width, height


def video_codec(path: Path) -> str:
    """Four characters for a video's codec, as FFmpeg names it.

    Raises:
        PocketGSError: the file is missing or not a readable video.
    """
    with _opened(path, upright=False) as video:
        return int(video.get(cv2.CAP_PROP_FOURCC)).to_bytes(4, "little").decode("ascii", "replace")


def read_frames(path: Path, indices: Sequence[int], *, upright: bool = True) -> Iterator[tuple[int, np.ndarray]]:
    """Decode some frames of a video, one at a time.

    Args:
        path: the video.
        indices: frame numbers from 0, in any order.
        upright: apply the rotation that the file states; otherwise frames are as stored.

    Yields:
        Each index once, ascending, and its frame: (H, W, 3) uint8 RGB.

    Raises:
        PocketGSError: the file is not a readable video, or it ends or is damaged before a requested frame.
    """
    wanted = sorted(set(indices))
    with _opened(path, upright) as video:
        position = 0
        for index in wanted:
            while position < index and video.grab():
                position += 1
            decoded, frame = video.read() if position == index else (False, None)
            if not decoded or frame is None:
                raise PocketGSError(f"{path}: frame {index} cannot be decoded, the video ends after {position} frames")
            position += 1
            yield index, cv2.cvtColor(frame, cv2.COLOR_BGR2RGB)


def sharpest_frames(path: Path, count: int) -> list[int]:
    """Divide a video into `count` equal windows and choose the sharpest frame of each.

    Returns:
        Frame numbers, ascending; all if the video has no more than `count`.

    Raises:
        PocketGSError: the file is not a readable video, or `count` is below 1.
    """
    return sharpest_in_windows(sharpness_of_frames(path), count)


def sharpness_of_frames(path: Path) -> list[float]:
    """Sharpness of every frame. All frames are decoded, so their number is exact, unlike a header's.

    Raises:
        PocketGSError: the file is not a readable video.
    """
    values = []
    with _opened(path, upright=False) as video:
        while True:
            decoded, frame = video.read()
            if not decoded:
                break
            values.append(sharpness(cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY)))
    if not values:
        raise PocketGSError(f"{path}: no frame can be decoded, expected a video")
    return values


@contextmanager
def _opened(path: Path, upright: bool) -> Iterator[cv2.VideoCapture]:
    if not path.is_file():
        raise PocketGSError(f"{path}: no such file, expected a video")
    # FFmpeg and OpenCV would print their own errors before ours.
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", str(FFMPEG_QUIET))
    level = cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    try:
        # An absolute path: FFmpeg takes the part before a colon for a protocol.
        video = cv2.VideoCapture(str(checked(path).resolve()), cv2.CAP_FFMPEG)
    finally:
        cv2.utils.logging.setLogLevel(level)
    try:
        if not video.isOpened():
            raise PocketGSError(f"{path}: cannot be opened as a video")
        width, height = (max(0.0, video.get(side)) for side in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT))
        require_memory(path, DECODING * width * height, f"frames of {width:.0f}x{height:.0f} pixels")
        video.set(cv2.CAP_PROP_ORIENTATION_AUTO, float(upright))
        yield video
    finally:
        video.release()
