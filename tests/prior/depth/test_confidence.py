"""Confidence of depths, and which of them fill holes."""

from __future__ import annotations

import numpy as np
import pytest

from pocketgs.prior.depth.confidence import FILLER_CONFIDENCE, FILLER_MARGIN, HOLE, confidence, confidence_map
from pocketgs.prior.depth.consistency import Agreement

LEAST = 0.4


def test_confidence() -> None:
    def of(agreeing: int, contradicting: int, margin: float) -> float:
        return float(confidence(np.array([agreeing]), np.array([contradicting]), np.float32([margin]))[0])

    assert of(0, 0, 1) == 0
    assert 0 < of(1, 0, 1) < of(2, 0, 1) < of(5, 0, 1) <= 1
    assert of(3, 0, 1) > of(3, 1, 1) > of(3, 3, 1) > 0
    assert of(3, 0, 1) > of(3, 0, 0.05) > of(3, 0, 0.01) > of(3, 0, 0) == 0


def agreement(agreeing: np.ndarray, contradicting: np.ndarray) -> Agreement:
    return Agreement(agreeing.astype(np.uint8), contradicting.astype(np.uint8), np.ones(agreeing.shape, np.float32))


@pytest.mark.parametrize("side", ["left", "right", "top", "bottom"])
def test_depths_in_holes_have_little_confidence(side: str) -> None:
    """On one side two views agree; from the seventh pixel beyond on, the squares around pixels are nearly empty."""
    agreeing, expected = np.zeros((40, 50), int), np.zeros((40, 50), np.float32)
    agreeing[:, :40], expected[:, :40] = 2, 0.75
    expected[:, 40 + HOLE // 2 - 1 :] = FILLER_CONFIDENCE
    if side in ("top", "bottom"):
        agreeing, expected = agreeing.T, expected.T
    if side in ("right", "bottom"):
        agreeing, expected = agreeing[::-1, ::-1], expected[::-1, ::-1]
    ones = np.ones(agreeing.shape, np.float32)
    found = confidence_map(agreement(agreeing, np.zeros_like(agreeing)), ones, ones, LEAST)
    assert found.dtype == np.float32
    np.testing.assert_array_equal(found, expected)


def test_what_fills_no_holes() -> None:
    """Unknown depths, those that a view contradicts, and those with a rival."""
    nothing = np.zeros((20, 20), int)
    depth, margin = np.ones((2, 20, 20), np.float32)
    contradicting = nothing.copy()
    contradicting[:, 3], depth[:, 5], margin[:, 7] = 1, 0, 0.99 * FILLER_MARGIN
    found = confidence_map(agreement(nothing, contradicting), depth, margin, LEAST)
    assert np.flatnonzero((found == 0).all(axis=0)).tolist() == [3, 5, 7]
    assert np.flatnonzero((found > 0).all(axis=0)).size == 17


def test_little_confidence_counts_as_none() -> None:
    ones = np.ones((20, 20), int)
    depth, margin = np.ones(ones.shape, np.float32), np.ones(ones.shape, np.float32)
    found = confidence_map(agreement(ones, ones), depth, margin, LEAST)
    assert confidence(ones, ones, margin)[0, 0] == 0.25
    assert not found.any()
