"""Videos as phones record them, which OpenCV's own encoders cannot write."""

from __future__ import annotations

import multiprocessing
import struct
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import av
import numpy as np


def write_h264(path: Path, images: Sequence[np.ndarray], states_colours: bool = True) -> None:
    """With frames that refer to later ones, so that they are not coded in the order in which they are shown."""
    colours = "colorprim=bt709:transfer=bt709:colormatrix=bt709" if states_colours else "bframes=3"
    _write(path, images, "libx264", "avc1", {"crf": "4", "preset": "fast", "x264-params": colours})


def write_hevc(path: Path, images: Sequence[np.ndarray]) -> None:
    """As the Stray Scanner app does."""
    _write(path, images, "libx265", "hvc1", {"crf": "10", "preset": "fast", "x265-params": "log-level=none"})


def without_first(mp4: bytes, frames: int) -> bytes:
    """A video whose edit list leaves out so many frames at its beginning (ISO 14496-12, 8.6.6)."""
    edit, durations = mp4.index(b"elst") + 16, mp4.index(b"stts") + 16
    [begin], [duration] = struct.unpack_from(">i", mp4, edit), struct.unpack_from(">I", mp4, durations)
    return mp4[:edit] + struct.pack(">i", begin + frames * duration) + mp4[edit + 4 :]


def _write(path: Path, images: Sequence[np.ndarray], codec: str, tag: str, options: dict[str, str]) -> None:
    """In a process of its own: what x264 makes of images depends on what its process did before."""
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        pool.submit(_encode, path, images, codec, tag, options).result()


def _encode(path: Path, images: Sequence[np.ndarray], codec: str, tag: str, options: dict[str, str]) -> None:
    with av.open(str(path), "w") as file:
        stream = file.add_stream(codec, rate=60, options=options)
        stream.height, stream.width = images[0].shape[:2]
        stream.pix_fmt = "yuv420p"
        stream.codec_context.codec_tag = tag
        for image in images:
            frame = av.VideoFrame.from_ndarray(image, format="rgb24").reformat(
                format="yuv420p", dst_colorspace="ITU709" if codec == "libx264" else None
            )
            file.mux(stream.encode(frame))
        file.mux(stream.encode())
