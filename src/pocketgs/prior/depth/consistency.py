"""Consistency of depth maps: what is compared, and what comes of it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Views(NamedTuple):
    """Depth maps of several views, padded to one size.

    Attributes:
        depths: (K, H, W) float32, 0 where unknown.
        intrinsics: (K, 4) float64 fx, fy, cx, cy.
        sizes: (K, 2) int64 true heights and widths.
        rotations, translations: (K, 3, 3) and (K, 3) float64, world to camera.
        steps: (K,) float64 difference in inverse depth of neighbouring hypotheses.
    """

    depths: np.ndarray
    intrinsics: np.ndarray
    sizes: np.ndarray
    rotations: np.ndarray
    translations: np.ndarray
    steps: np.ndarray


class Agreement(NamedTuple):
    """How one view's depths compare with the other views'.

    Attributes:
        agreeing: (H, W) uint16 number of views that agree.
        contradicting: (H, W) uint16 number that see through the point to something behind it.
        footprints: (H, W) float32 smallest footprint of a pixel at the point, in this view or one that agrees.
    """

    agreeing: np.ndarray
    contradicting: np.ndarray
    footprints: np.ndarray


class ConfidenceMap(NamedTuple):
    """How far one view's depths are believed.

    Attributes:
        confidences: (H, W) float32 in [0, 1], 0 for depths that are not used; see `pocketgs.prior.depth.confidence`.
        footprints: (H, W) float32, as in `Agreement`.
    """

    confidences: np.ndarray
    footprints: np.ndarray
