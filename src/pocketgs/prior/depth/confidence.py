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


def confidence_map(agreement: Agreement, depth: np.ndarray, margin: np.ndarray, least: float) -> np.ndarray:
    """(H, W) float32 confidence of depths, and in the holes between them of those that nothing contradicts.

    Args:
        agreement: of the depths with other views'.
        depth: (H, W), 0 where unknown.
        margin: (H, W) share by which the depth is cheaper than the next best.
        least: minimum confidence outside holes; what has less counts as 0.
    """
    agreeing, contradicting, _ = agreement
    confidences = confidence(agreeing, contradicting, margin)
    kept = np.where(confidences >= least, confidences, np.float32(0))
    fillers = holes(kept > 0) & (depth > 0) & (contradicting == 0) & (margin >= FILLER_MARGIN)
    kept[fillers] = FILLER_CONFIDENCE
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
