"""Consistency of depth maps: the views to compare, how far they agree, and how far depths are believed."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pocketgs.prior.depth.source_views import LEAST_PARALLAX

AROUND, COHERENT_STEPS = 3, 2.0
"""A depth is coherent if at least half of the known ones around it, up to so many rows and columns away, are within so
many steps of the sweep.

Where nothing matches, at the edges of photographs and on surfaces seen from very different sides, depths are noise. It
agrees with some other view by chance, and Gaussians there hang in the air before other views.
"""

CONFIRMED = 2
"""Number of agreeing views that confirm a depth that is not coherent, such as that of a twig."""


class SweptViews(NamedTuple):
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


def farthest_confirmed(views: SweptViews, view: int) -> np.ndarray:
    """(K,) float64 depths of a view up to which the agreement of each view counts; infinite if it counts for all.

    Copies of the view agree with it whatever its depths are. Farther than that depth, a baseline is too short to tell
    distances. But the background is confirmed by all views that tell the distance of what the view mostly shows: no
    baseline is long enough for it, and its depth does not have to be exact.
    """
    height, width = views.sizes[view]
    depths = views.depths[view, :height, :width]
    known = depths[depths > 0].astype(np.float64)
    typical = float(np.median(known)) if len(known) else 0.0
    shifts = views.translations - views.rotations @ views.rotations[view].T @ views.translations[view]
    told = np.linalg.norm(shifts, axis=1) / LEAST_PARALLAX
    return np.where(told >= typical, np.inf, told)


class Agreement(NamedTuple):
    """How one view's depths compare with the other views'.

    Attributes:
        agreeing: (H, W) uint16 number of views that agree, without copies of the view.
        contradicting: (H, W) uint16 number that see through the point to something behind it, and one more where the
            depth is not coherent and fewer than CONFIRMED views agree.
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
