"""Videos of which a part is there, as when a transfer broke off."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import av
import numpy as np


def film(path: Path, frames: Sequence[np.ndarray], codec: str = "mpeg4") -> bytes:
    """Write a video of 30 frames a second whose header comes first, and return the file's content.

    Every tenth frame is complete in itself.
    """
    with av.open(str(path), "w", options={"movflags": "faststart"} if path.suffix == ".mp4" else {}) as file:
        stream = file.add_stream(codec, rate=30)
        stream.pix_fmt, stream.gop_size = "yuv420p", 10
        stream.height, stream.width = frames[0].shape[:2]
        for frame in frames:
            file.mux(stream.encode(av.VideoFrame.from_ndarray(frame, format="rgb24")))
        file.mux(stream.encode(None))
    return path.read_bytes()


def write_cut_off(path: Path) -> None:
    """Write half of a video of 90 frames of noise."""
    generator = np.random.default_rng(0)
    content = film(path, list(generator.integers(0, 256, (90, 48, 64, 3), dtype=np.uint8)))
    path.write_bytes(content[: len(content) // 2])
