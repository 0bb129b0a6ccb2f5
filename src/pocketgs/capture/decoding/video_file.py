"""Video decoding. Frames are always decoded in order: seeking is not reliable with every codec."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from pocketgs.capture.decoding.video_colours import is_srgb, to_srgb
from pocketgs.capture.sharpness import sharpest_in_windows, sharpness
from pocketgs.errors import PocketGSError
from pocketgs.files.memory_bound import require_memory
from pocketgs.files.opening import checked

if TYPE_CHECKING:
    import av

VIDEO_SUFFIXES = frozenset({".mp4", ".mov", ".m4v", ".avi", ".mkv", ".webm", ".3gp"})
DECODING = 40
"""Bytes per pixel while a frame is decoded: its planes, the reference frames, and its colours, of 16 bits for HDR."""

ENOUGH = 0.9
"""Share of the time that a video states, above which its file is taken to be whole. Headers are not exact."""

OF_RGB, FULL_RANGE = 0, 2
"""Numbers of the matrix and of the range of RGB (ITU-T H.273)."""

EIGHT_BITS, SIXTEEN_BITS = "rgb24", "gbrp16le"
"""Pixel formats of RGB. FFmpeg 8.0 converts 10 bits to packed 16 bits wrongly, but not to planes."""

WITH_BRIGHTNESS = frozenset({"yuv420p", "yuvj420p", "nv12"})
"""Pixel formats whose first plane is the brightness in bytes: those of most videos. Converting takes as long as
decoding."""


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
    with _decoded(path) as video:
        frame = next(video.frames, None)
        if frame is None:
            raise PocketGSError(f"{path}: no frame can be decoded, expected a video")
        is_turned = upright and _quarter_turns(frame) % 2 == 1
        return (frame.height, frame.width) if is_turned else (frame.width, frame.height)


def video_comment(path: Path) -> str:
    """The comment that a video's file states; empty if there is none.

    Raises:
        PocketGSError: the file is missing or not a readable video.
    """
    with _opened(path) as file:
        return file.metadata.get("comment", "")


def read_frames(path: Path, indices: Sequence[int], *, upright: bool = True) -> Iterator[tuple[int, np.ndarray]]:
    """Decode some frames of a video, one at a time. HDR and wide gamuts become sRGB.

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
    with _decoded(path) as video:
        position = 0
        for index in wanted:
            frame = None
            while position <= index and (frame := next(video.frames, None)) is not None:
                position += 1
            if frame is None:
                raise PocketGSError(f"{path}: frame {index} cannot be decoded, the video ends after {position} frames")
            yield index, video.pixels(frame, upright)


def early_end(path: Path) -> str:
    """What to say of a video whose file ends before it, as when a transfer broke off; empty if it is whole.

    Nothing is decoded: damage inside is found by `sharpest_frames`.

    Raises:
        PocketGSError: the file is missing or not a readable video.
    """
    extent = _extent(path)
    return "" if extent.is_whole else _ending(path, extent.frames, extent.stated)


def sharpest_frames(path: Path, count: int, on_warning: Callable[[str], None] = lambda warning: None) -> list[int]:
    """Divide a video into `count` equal windows and choose the sharpest frame of each.

    Args:
        path: the video.
        count: number of windows.
        on_warning: called if the video is damaged, or ends early: only what comes before is divided.

    Returns:
        Frame numbers, ascending; all if the video has no more than `count`.

    Raises:
        PocketGSError: the file is not a readable video, or `count` is below 1.
    """
    values, is_damaged = _sharpness(path)
    extent = _extent(path)
    if not extent.is_whole or (is_damaged and not 0 < extent.stated <= len(values)):
        on_warning(_ending(path, len(values), extent.stated))
    return sharpest_in_windows(values, count)


def sharpness_of_frames(path: Path) -> list[float]:
    """Sharpness of every frame. All frames are decoded, so their number is exact, unlike a header's.

    Raises:
        PocketGSError: the file is not a readable video.
    """
    return _sharpness(path)[0]


def _sharpness(path: Path) -> tuple[list[float], bool]:
    """Sharpness of every frame, and whether damage ended them."""
    with _decoded(path) as video:
        values = [sharpness(_brightness(frame)) for frame in video.frames]
        is_damaged = bool(video.damage)
    if not values:
        raise PocketGSError(f"{path}: no frame can be decoded, expected a video")
    return values, is_damaged


@dataclass(frozen=True)
class _Extent:
    """How much of a video is in its file.

    Attributes:
        frames: their number, decodable or not.
        stated: the number in the whole video, nearly; 0 if unknown.
        is_whole: whether they fill the time that the file states. (Frames may be fewer: of a trimmed video, hidden ones
            count too.)
    """

    frames: int
    stated: int
    is_whole: bool


def _extent(path: Path) -> _Extent:
    import av

    with _opened(path) as file:
        stream = _video_in(file, path)
        stated, watched = float((stream.duration or 0) * (stream.time_base or 0)), [stream]
        if not stated:  # as in Matroska, whose files state the time of their longest stream
            stated, watched = (file.duration or 0) / av.time_base, []
        frames, times = 0, list[float]()
        for packet in _until_damage(file.demux(*watched), []):
            frames += packet.size > 0 and packet.stream.index == stream.index
            begin = packet.dts if packet.pts is None else packet.pts
            if begin is not None:
                times += [float(when * packet.time_base) for when in (begin, begin + (packet.duration or 0))]
        whole = round(stated * float(stream.average_rate or 0)) or stream.frames
    return _Extent(frames, whole, max(times, default=0.0) - min(times, default=0.0) >= ENOUGH * stated)


def _ending(path: Path, frames: int, stated: int) -> str:
    found = f"{frames} of {stated}" if stated > frames else f"{frames}"
    return f"{path}: is damaged or not there as a whole, and ends after {found} frames: copy it from the camera again"


@dataclass(frozen=True)
class _DecodedVideo:
    """A video while it is decoded.

    Attributes:
        stream: the one that frames come from.
        frames: in the order in which they are shown.
        damage: what ended them before the video's end, if anything did so far.
    """

    stream: av.VideoStream
    frames: Iterator[av.VideoFrame]
    damage: list[av.FFmpegError]

    def pixels(self, frame: av.VideoFrame, upright: bool) -> np.ndarray:
        """(H, W, 3) uint8 sRGB."""
        codec = self.stream.codec_context
        stated = codec.color_primaries, codec.color_trc
        image = _in_rgb(frame, EIGHT_BITS) if is_srgb(*stated) else to_srgb(_in_rgb(frame, SIXTEEN_BITS), *stated)
        return np.ascontiguousarray(np.rot90(image, _quarter_turns(frame))) if upright else image


def _in_rgb(frame: av.VideoFrame, pixel_format: str) -> np.ndarray:
    """(H, W, 3) RGB by the matrix that the video states, which PyAV before 17 uses only where the other one differs."""
    return frame.to_ndarray(
        format=pixel_format,
        src_colorspace=int(frame.colorspace),
        dst_colorspace=OF_RGB,
        src_color_range=int(frame.color_range),
        dst_color_range=FULL_RANGE,
    )


def _brightness(frame: av.VideoFrame) -> np.ndarray:
    """(H, W) uint8, as stored."""
    if frame.format.name not in WITH_BRIGHTNESS:
        return frame.to_ndarray(format="gray")
    plane = frame.planes[0]
    return np.frombuffer(memoryview(plane), np.uint8).reshape(-1, plane.line_size)[: frame.height, : frame.width]


def _quarter_turns(frame: av.VideoFrame) -> int:
    """Counterclockwise quarter turns that bring a frame upright, as the file states."""
    degrees = frame.rotation  # of a damaged matrix, any number
    return degrees // 90 if degrees % 90 == 0 and abs(degrees) <= 360 else 0


@contextmanager
def _opened(path: Path) -> Iterator[av.container.InputContainer]:
    import av  # here, since few commands need FFmpeg's libraries

    if not path.is_file():
        raise PocketGSError(f"{path}: no such file, expected a video")
    try:
        # An absolute path: FFmpeg takes the part before a colon for a protocol.
        file = av.open(str(checked(path).resolve()))
    except (av.FFmpegError, ValueError) as error:
        raise PocketGSError(f"{path}: cannot be opened as a video") from error
    with file:
        yield file


@contextmanager
def _decoded(path: Path) -> Iterator[_DecodedVideo]:
    with _opened(path) as file:
        stream = _video_in(file, path)
        width, height = stream.codec_context.width, stream.codec_context.height
        require_memory(path, DECODING * width * height, f"frames of {width}x{height} pixels")
        stream.thread_type = "AUTO"
        damage = list[Any]()
        yield _DecodedVideo(stream, _until_damage(_of_one_size(file.decode(stream)), damage), damage)


def _video_in(file: av.container.InputContainer, path: Path) -> av.VideoStream:
    """The stream to decode: some files have a preview or a cover before it."""
    import av

    stream = file.streams.best("video")
    if not isinstance(stream, av.VideoStream) or stream.codec_context is None:  # without a codec, FFmpeg has no decoder
        raise PocketGSError(f"{path}: cannot be opened as a video")
    return stream


Part = TypeVar("Part")


def _until_damage(parts: Iterator[Part], damage: list[av.FFmpegError]) -> Iterator[Part]:
    """Packets or frames until the end, or until something is damaged: after it, frames would have wrong numbers."""
    import av

    try:
        yield from parts
    except av.FFmpegError as error:
        if isinstance(error, MemoryError):  # not the video's fault
            raise
        damage.append(error)


def _of_one_size(frames: Iterator[av.VideoFrame]) -> Iterator[av.VideoFrame]:
    size: tuple[int, int] | None = None
    for frame in frames:
        size = size or (frame.width, frame.height)
        yield frame if (frame.width, frame.height) == size else frame.reformat(*size)
