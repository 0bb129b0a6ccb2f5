"""HDR and wide gamuts of videos become sRGB: against the forward formulas of the standards, and in real files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from capture.hdr_videos import BT2020_FROM_709, PALETTE, hlg_signal, pq_signal, write_hdr
from pocketgs.capture.decoding.video_colours import HLG, PQ, REFERENCE_WHITE, is_srgb, to_srgb
from pocketgs.capture.decoding.video_file import read_frames, sharpness_of_frames, video_size

BT709, BT2020, DISPLAY_P3, SDR, UNKNOWN = 1, 9, 12, 1, 2
SIGNALS = {HLG: hlg_signal, PQ: pq_signal}

P3_TO_SRGB = np.array([[1.2249, -0.2247, 0.0], [-0.0420, 1.0419, 0.0], [-0.0197, -0.0786, 1.0979]])


def encoded(linear: np.ndarray) -> np.ndarray:
    """Linear values as sRGB (IEC 61966-2-1)."""
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 0.0) ** (1 / 2.4) - 0.055)


def mapped_to_srgb(signal: np.ndarray, primaries: int, transfer: int) -> np.ndarray:
    """(N, 3) from 0 to 1, of a signal from 0 to 1."""
    return to_srgb(np.round(65535 * signal[:, None]).astype(np.uint16), primaries, transfer)[:, 0] / 255


@pytest.mark.parametrize("transfer", [HLG, PQ])
@given(st.lists(st.tuples(*[st.floats(0.0, 0.5)] * 3), min_size=1, max_size=20))
def test_colours_darker_than_half_of_white_stay(transfer, colours):
    linear = np.array(colours)
    signal = SIGNALS[transfer](REFERENCE_WHITE * linear @ BT2020_FROM_709.T)
    np.testing.assert_allclose(mapped_to_srgb(signal, BT2020, transfer), encoded(linear), atol=0.01)


@pytest.mark.parametrize("transfer", [HLG, PQ])
def test_highlights_are_compressed_to_white(transfer):
    luminance = np.linspace(0.0, 1000.0, 400)[:, None] * np.ones(3)
    mapped = mapped_to_srgb(SIGNALS[transfer](luminance), BT2020, transfer)
    np.testing.assert_allclose(mapped, mapped[:, :1] * np.ones(3), atol=1.5 / 255)  # grey stays grey
    assert (np.diff(mapped[:, 1]) >= 0).all()
    assert mapped[0].max() < 1e-3
    assert mapped[-1].min() > 0.999
    [paper] = mapped_to_srgb(SIGNALS[transfer](np.full((1, 3), REFERENCE_WHITE)), BT2020, transfer)
    assert 0.85 < paper.min() < 0.95


def test_brighter_than_the_peak_is_white():
    assert mapped_to_srgb(np.ones((1, 3)), BT2020, PQ).min() > 0.999


def test_a_bright_colour_keeps_its_hue():
    linear = np.array([[2.0, 1.0, 0.5]])
    mapped = mapped_to_srgb(hlg_signal(REFERENCE_WHITE * linear @ BT2020_FROM_709.T), BT2020, HLG)
    red, green, blue = ((mapped[0] + 0.055) / 1.055) ** 2.4
    assert red < 1.0
    assert red / green == pytest.approx(2.0, rel=0.01)
    assert green / blue == pytest.approx(2.0, rel=0.01)


def test_display_p3():
    linear = np.random.default_rng(0).uniform(size=(100, 3))
    expected = encoded(np.clip(linear @ P3_TO_SRGB.T, 0.0, 1.0))
    np.testing.assert_allclose(mapped_to_srgb(encoded(linear), DISPLAY_P3, SDR), expected, atol=1.5 / 255)


@pytest.mark.parametrize(("primaries", "transfer"), [(BT709, SDR), (UNKNOWN, UNKNOWN), (0, 0), (6, 6), (BT709, 13)])
def test_most_videos_are_srgb(primaries, transfer):
    assert is_srgb(primaries, transfer)


@given(st.integers(1, 100), st.integers(1, 20))
def test_every_row_is_mapped_alike(height, width):
    frame = np.random.default_rng(height).integers(0, 1 << 16, (height, width, 3), dtype=np.uint16)
    rows = [to_srgb(row[None], BT2020, HLG) for row in frame]
    np.testing.assert_array_equal(to_srgb(frame, BT2020, HLG), np.concatenate(rows))


@pytest.mark.parametrize("transfer", [HLG, PQ])
@pytest.mark.parametrize("primaries", [BT2020, BT709])
def test_videos(tmp_path: Path, transfer: int, primaries: int) -> None:
    path = tmp_path / "hdr.mkv"
    write_hdr(path, frames=3, primaries=primaries, transfer=transfer)
    [(_, frame)] = read_frames(path, [1])
    height, width = frame.shape[:2]
    assert video_size(path) == (width, height)
    side = width // len(PALETTE)
    middles = frame[height // 2, side // 2 :: side].astype(float)
    np.testing.assert_allclose(middles, 255 * encoded(np.array(PALETTE)), atol=3)
    assert len(sharpness_of_frames(path)) == 3
