"""HDR videos in the colours that phones record: ten bits, in HLG or PQ."""

from __future__ import annotations

from pathlib import Path

import av
import numpy as np

PALETTE = [(0.0, 0.0, 0.0), (0.5, 0.5, 0.5), (0.18, 0.18, 0.18), (0.4, 0.1, 0.1), (0.1, 0.4, 0.1), (0.1, 0.1, 0.4)]
"""Linear BT.709 colours, of which 1 is as bright as paper: from the left to the right of `write_hdr`'s frames."""

PAPER = 203.0
"""cd/m² (ITU-R BT.2408)."""

SIDE = 64
"""Pixels of a colour's square."""

BT2020_FROM_709 = np.array([[0.6274, 0.3293, 0.0433], [0.0691, 0.9195, 0.0114], [0.0164, 0.0880, 0.8956]])
"""Linear colours (ITU-R BT.2087, equation 5)."""


def hlg_signal(luminance: np.ndarray) -> np.ndarray:
    """(N, 3) signal of BT.2020 colours in cd/m² on a display of 1,000 cd/m² (ITU-R BT.2100, table 5)."""
    relative = np.maximum(luminance, 0.0) / 1000.0
    total = relative @ np.array([0.2627, 0.6780, 0.0593])
    scene = relative * np.maximum(total, 1e-12)[:, None] ** ((1 - 1.2) / 1.2)
    a, b, c = 0.17883277, 0.28466892, 0.55991073
    return np.where(scene <= 1 / 12, np.sqrt(3 * scene), a * np.log(np.maximum(12 * scene - b, 1e-12)) + c)


def pq_signal(luminance: np.ndarray) -> np.ndarray:
    """(N, 3) signal of colours in cd/m² (ITU-R BT.2100, table 4)."""
    power = (np.maximum(luminance, 0.0) / 10000.0) ** 0.1593017578125
    return ((0.8359375 + 18.8515625 * power) / (1 + 18.6875 * power)) ** 78.84375


def write_hdr(path: Path, frames: int, primaries: int, transfer: int) -> None:
    """Frames that show the palette, without loss.

    Args:
        path: ending in .mkv.
        frames: how many.
        primaries: 1 or 9.
        transfer: 16 or 18.
    """
    linear = np.array(PALETTE)
    luminance = PAPER * (linear @ BT2020_FROM_709.T if primaries == 9 else linear)
    row = (hlg_signal if transfer == 18 else pq_signal)(luminance)
    signal = np.repeat(np.repeat(row[None], SIDE, axis=0), SIDE, axis=1)
    picture = av.VideoFrame.from_ndarray(np.round(65535 * signal).astype(np.uint16), format="rgb48le")
    stored = picture.reformat(
        format="yuv420p10le", src_colorspace=0, dst_colorspace=9, src_color_range=2, dst_color_range=1
    )
    with av.open(str(path), "w") as file:
        stream = file.add_stream("ffv1", rate=30)
        stream.height, stream.width = signal.shape[:2]
        stream.pix_fmt = "yuv420p10le"
        codec = stream.codec_context
        codec.colorspace, codec.color_range, codec.color_primaries, codec.color_trc = 9, 1, primaries, transfer
        for number in range(frames):
            stored.pts = number
            file.mux(stream.encode(stored))
        file.mux(stream.encode())
