"""Writing rendered frames as an .mp4 file."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from fractions import Fraction
from pathlib import Path
from typing import BinaryIO

import av
import numpy as np
from av.codec.codec import UnknownCodecError

from pocketgs.capture.decoding.video_file import FULL_RANGE, OF_RGB, video_comment
from pocketgs.errors import PocketGSError
from pocketgs.files.atomic_file import replacing

CODEC, PIXELS = "libx264", "yuv420p"
"""H.264 with halved colour resolution: what phones, browsers and messengers play."""

QUALITY = {"crf": "18", "preset": "medium"}
"""A constant rate factor at which eyes hardly tell the video from the pictures."""

BT709, LIMITED = 1, 1
"""Numbers of colours and ranges in video files (ITU-T H.273)."""

TO_BT709 = {
    "src_colorspace": OF_RGB,
    "dst_colorspace": BT709,
    "src_color_range": FULL_RANGE,
    "dst_color_range": LIMITED,
}

MARK = "rendered by PocketGS"
"""Comment in the file, by which a video that may be replaced is told from a camera's."""

SLOWEST, FASTEST = 0.1, 1000.0
"""Range of frame rates."""


def write_video(path: str | Path, frames: Iterable[np.ndarray], fps: float = 30.0) -> None:
    """Encode frames as H.264 video, one at a time.

    The file is written atomically.

    Args:
        path: ending in .mp4.
        frames: (H, W, 3) uint8 RGB, all of one size. An odd row or column at the bottom or right is cropped, since the
            codec needs even sizes.
        fps: frames per second.

    Raises:
        PocketGSError: the path does not end in .mp4 or cannot be written, there are no frames, one is not an RGB image
            of the first one's size, or they are too large for the codec.
    """
    path = Path(path)
    if path.suffix.lower() != ".mp4":
        raise PocketGSError(f"{path}: a video's name ends in .mp4, found {path.suffix or 'no suffix'}")
    if not SLOWEST <= fps <= FASTEST:
        raise PocketGSError(f"fps: found {fps}, expected {SLOWEST} to {FASTEST}")
    if not path.parent.is_dir():
        raise PocketGSError(f"{path}: there is no folder {path.parent}")
    with replacing(path) as partial, partial.open("wb") as file:
        try:
            _encode(file, _even_frames(frames, path), fps)
        except (av.FFmpegError, UnknownCodecError) as error:
            raise PocketGSError(f"{path}: cannot be written as H.264 video ({error})") from error


def is_written_video(path: Path) -> bool:
    """Whether a file is a video that `write_video` wrote.

    Raises:
        PocketGSError: it is not a readable video.
    """
    return video_comment(path) == MARK


def _encode(file: BinaryIO, frames: Iterable[np.ndarray], fps: float) -> None:
    """Write frames of one even size. Python writes the file, so that a full disk is an error."""
    stream = None
    with av.open(file, "w", format="mp4") as container:
        container.metadata["comment"] = MARK
        for frame in frames:
            if stream is None:
                stream = container.add_stream(CODEC, rate=Fraction(fps).limit_denominator(1001), options=QUALITY)
                stream.height, stream.width = frame.shape[:2]
                stream.pix_fmt = PIXELS
                codec = stream.codec_context
                codec.colorspace = codec.color_primaries = codec.color_trc = BT709
                codec.color_range = LIMITED
            picture = av.VideoFrame.from_ndarray(frame, format="rgb24")
            container.mux(stream.encode(picture.reformat(format=PIXELS, **TO_BT709)))
        if stream is not None:
            container.mux(stream.encode())


def even_size(width: int, height: int) -> tuple[int, int]:
    """Width and height in a video, which has no odd row or column."""
    return width // 2 * 2, height // 2 * 2


def _even_frames(frames: Iterable[np.ndarray], path: Path) -> Iterator[np.ndarray]:
    """The frames without an odd row or column, checked; errors name `path`."""
    size: tuple[int, int] | None = None
    for number, frame in enumerate(frames):
        if frame.ndim != 3 or frame.shape[2] != 3 or frame.dtype != np.uint8 or min(frame.shape[:2]) < 2:
            found = f"{frame.dtype} of shape {frame.shape}"
            raise PocketGSError(f"{path}: frame {number} is {found}, expected uint8 of shape (H, W, 3)")
        width, height = even_size(frame.shape[1], frame.shape[0])
        size = size or (width, height)
        if (width, height) != size:
            raise PocketGSError(f"{path}: frame {number} has size {(width, height)}, expected {size} like the first")
        yield np.ascontiguousarray(frame[:height, :width])
    if size is None:
        raise PocketGSError(f"{path}: no frames to write, expected at least one")
