"""Confidence of depths: by how many views agree, and in holes by none that contradicts."""

from __future__ import annotations

import cv2
import numpy as np

from pocketgs.prior.depth.consistency import Agreement

CLEAR_MARGIN = 0.1
"""Margin to the next best depth that gives full confidence."""

HOLE, HOLE_SHARE = 15, 0.1
"""A hole is a pixel with less than this share of confident pixels in a square of this side around it."""

FILLER_MARGIN, FILLER_CONFIDENCE = 0.05, 0.1
"""Minimum margin of depths that fill holes: no view confirms them, but none contradicts them.

Without any points, Gaussians would have to grow into the hole from its surroundings, which they do badly.
"""

COHERENT_SIDE, COHERENT_STEPS = 7, 2.0
"""A depth is coherent if most pixels of a square of this side around it are within this many steps of the sweep.

Where nothing matches, at the edges of photographs and at surfaces seen from very different sides, depths are noise.
Gaussians there hang in the air before other views. The interpolated depth of the surroundings is a better guess.
"""


def confidence_map(
    agreement: Agreement, depth: np.ndarray, margin: np.ndarray, step: float, least: float
) -> np.ndarray:
    """(H, W) float32 confidence of depths, and in the holes between them of coherent ones that nothing contradicts.

    Args:
        agreement: of the depths with other views'.
        depth: (H, W) float32, 0 where unknown.
        margin: (H, W) share by which the depth is cheaper than the next best.
        step: difference in inverse depth of neighbouring hypotheses.
        least: minimum confidence outside holes; what has less counts as 0.
    """
    agreeing, contradicting, _ = agreement
    confidences = confidence(agreeing, contradicting, margin)
    kept = np.where(confidences >= least, confidences, np.float32(0))
    fillers = holes(kept > 0) & (depth > 0) & (contradicting == 0) & (margin >= FILLER_MARGIN)
    rows, columns = np.nonzero(fillers)
    sound = coherent(depth, step, rows, columns)
    kept[rows[sound], columns[sound]] = FILLER_CONFIDENCE
    return kept


def confidence(agreeing: np.ndarray, contradicting: np.ndarray, margin: np.ndarray) -> np.ndarray:
    """Confidence in [0, 1] of depths.

    Every view that agrees halves the doubt; views that see through the point divide the confidence; depths that are
    hardly cheaper than another get little confidence.

    Args:
        agreeing: number of other views that agree.
        contradicting: number of other views that see something behind the point.
        margin: share by which the depth is cheaper than the next best.
    """
    votes = agreeing.astype(np.float32)
    support = (1 - np.float32(0.5) ** votes) * votes / np.maximum(votes + contradicting, 1)
    return support * np.minimum(margin / np.float32(CLEAR_MARGIN), 1)


def holes(believed: np.ndarray) -> np.ndarray:
    """(H, W) bool: pixels with few confident depths around them."""
    return cv2.boxFilter(believed.astype(np.float32), -1, (HOLE, HOLE), borderType=cv2.BORDER_REFLECT) < HOLE_SHARE


def coherent(depth: np.ndarray, step: float, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """(N,) bool: pixels whose depth is that of most pixels around them.

    Inverse depths 1/a and 1/b are compared as |a - b| ≤ s a b, without a division, whose rounding devices differ in.

    Args:
        depth: (H, W) float32, 0 where unknown.
        step: difference in inverse depth of neighbouring hypotheses.
        rows: (N,) of the pixels.
        columns: (N,) of the pixels.
    """
    around = np.pad(depth, COHERENT_SIDE // 2, mode="symmetric")
    here, tolerance = depth[rows, columns], np.float32(COHERENT_STEPS * step)
    close = np.zeros(len(rows), np.int32)
    for i in range(COHERENT_SIDE):
        for j in range(COHERENT_SIDE):
            there = around[rows + i, columns + j]
            close += np.abs(there - here) <= tolerance * here * there
    return 2 * close > COHERENT_SIDE**2
