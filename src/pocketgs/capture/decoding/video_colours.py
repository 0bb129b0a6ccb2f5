"""Colours of videos brought to sRGB, as photographs are: phones record HDR, and in wider gamuts.

Without that, the frames of an HDR video would look flat and pale, and so would the scene.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

PRIMARIES = {
    9: ((0.708, 0.292), (0.170, 0.797), (0.131, 0.046)),  # BT.2020
    12: ((0.680, 0.320), (0.265, 0.690), (0.150, 0.060)),  # Display P3
}
"""Chromaticities of red, green and blue by their number in video files (ITU-T H.273, table 2); all with white D65."""

SRGB_PRIMARIES = ((0.640, 0.330), (0.300, 0.600), (0.150, 0.060))
D65 = (0.3127, 0.3290)

PQ, HLG = 16, 18
"""Numbers of the transfer functions of HDR in video files (ITU-T H.273, table 3)."""

PEAK = 1000.0
"""Luminance of the brightest colours of HDR in cd/m²: HLG's nominal peak, and what phones master PQ for."""

REFERENCE_WHITE = 203.0
"""Luminance of white paper in HDR, in cd/m² (ITU-R BT.2408, table 1)."""

KNEE = 0.5
"""Share of paper's luminance up to which HDR's colours stay as they are; brighter ones are compressed."""

LUMINANCE = np.array([0.2627, 0.6780, 0.0593], np.float32)
"""Weights of BT.2020's primaries (ITU-R BT.2100, table 5)."""

ROWS_AT_ONCE = 32
"""Rows of a frame that are mapped together: few enough to stay in the processor's caches."""


def is_srgb(primaries: int, transfer: int) -> bool:
    """Whether a video's colours can be taken for sRGB's, as those of BT.709 and unstated ones.

    Args:
        primaries: number of the colour primaries that the video states (ITU-T H.273, table 2).
        transfer: number of the transfer function that it states (table 3).
    """
    return primaries not in PRIMARIES and transfer not in (PQ, HLG)


def to_srgb(frame: np.ndarray, primaries: int, transfer: int) -> np.ndarray:
    """A frame in sRGB.

    HDR keeps the contrast of what is darker than half of white paper; what is brighter is compressed to white.

    Args:
        frame: (H, W, 3) uint16 RGB, as decoded.
        primaries: as `is_srgb` takes it.
        transfer: as `is_srgb` takes it.

    Returns:
        (H, W, 3) uint8.
    """
    linear_of, srgb_of = _linear_by_signal(transfer), _srgb_by_linear()
    matrix = _matrix_to_srgb(primaries)
    mapped = np.empty(frame.shape, np.uint8)
    for start in range(0, len(frame), ROWS_AT_ONCE):
        linear = linear_of[frame[start : start + ROWS_AT_ONCE]]
        if transfer == HLG:
            linear *= np.power(linear @ LUMINANCE, np.float32(0.2))[..., None] * np.float32(PEAK / REFERENCE_WHITE)
        linear = np.maximum(linear @ matrix, np.float32(0.0))
        if transfer in (PQ, HLG):
            _compress_highlights(linear)
        index = np.minimum(linear, np.float32(1.0)) * np.float32(len(srgb_of) - 1) + np.float32(0.5)
        mapped[start : start + ROWS_AT_ONCE] = srgb_of[index.astype(np.int32)]
    return mapped


@lru_cache(maxsize=2)
def _linear_by_signal(transfer: int) -> np.ndarray:
    """(65536,) float32: the scene's light from 0 to 1 for HLG, multiples of paper's luminance for PQ, else sRGB's."""
    signal = np.linspace(0.0, 1.0, 1 << 16)
    if transfer == HLG:  # ITU-R BT.2100, table 5
        a, b, c = 0.17883277, 0.28466892, 0.55991073
        linear = np.where(signal <= 0.5, signal**2 / 3.0, (np.exp((signal - c) / a) + b) / 12.0)
    elif transfer == PQ:  # table 4
        m1, m2, c1, c2, c3 = 2610 / 16384, 2523 / 32, 3424 / 4096, 2413 / 128, 2392 / 128
        root = signal ** (1 / m2)
        luminance = 10000.0 * (np.maximum(root - c1, 0.0) / (c2 - c3 * root)) ** (1 / m1)
        linear = np.minimum(luminance, PEAK) / REFERENCE_WHITE
    else:  # IEC 61966-2-1
        linear = np.where(signal <= 0.04045, signal / 12.92, ((signal + 0.055) / 1.055) ** 2.4)
    return linear.astype(np.float32)


@lru_cache(maxsize=1)
def _srgb_by_linear() -> np.ndarray:
    """uint8 by even steps from 0 to 1, fine enough for the darkest colours (IEC 61966-2-1)."""
    linear = np.linspace(0.0, 1.0, 1 << 14)
    encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    return np.round(255.0 * encoded).astype(np.uint8)


def _compress_highlights(linear: np.ndarray) -> None:
    """Scale colours whose largest part is above the knee, so that the peak becomes 1.

    With t from 0 at the knee to 1 at the peak, the largest part becomes KNEE + (1 - KNEE) t (1 + s) / (t + s); s makes
    the curve as steep at the knee as below. Scaling all three parts alike keeps the hue.
    """
    peak = PEAK / REFERENCE_WHITE
    s = np.float32((1.0 - KNEE) / (peak - 1.0))
    red, green, blue = np.split(linear, 3, axis=-1)  # NumPy is slow at the largest of three
    largest = np.maximum(np.maximum(red, green), np.maximum(blue, np.float32(KNEE)))
    t = np.minimum((largest - np.float32(KNEE)) / np.float32(peak - KNEE), np.float32(1.0))
    linear *= (np.float32(KNEE) + np.float32(1.0 - KNEE) * t * (1 + s) / (t + s)) / largest


@lru_cache(maxsize=2)
def _matrix_to_srgb(primaries: int) -> np.ndarray:
    """(3, 3) float32 for linear colours in rows."""
    to_xyz, srgb_to_xyz = _to_xyz(PRIMARIES.get(primaries, SRGB_PRIMARIES)), _to_xyz(SRGB_PRIMARIES)
    return np.ascontiguousarray(np.linalg.solve(srgb_to_xyz, to_xyz).T, np.float32)


def _to_xyz(primaries: tuple[tuple[float, float], ...]) -> np.ndarray:
    """(3, 3) matrix from linear RGB to XYZ, with white of luminance 1 (SMPTE RP 177)."""
    columns = np.array([(x / y, 1.0, (1.0 - x - y) / y) for x, y in (*primaries, D65)]).T
    return columns[:, :3] * np.linalg.solve(columns[:, :3], columns[:, 3])
