"""The depth range of a keyframe's surfaces, from a full-range sweep of a small copy and from sparse points."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pocketgs.capture.capture import Frame
from pocketgs.capture.frame_edits import downscaled

QUANTILES = (0.005, 0.995)
"""Quantiles of inverse depth: values outside are wrong matches rather than surfaces."""

NEAREST_SHARE, NEAREST_QUANTILE = 0.3, 0.02
"""The full-range sweep starts at this share of this quantile of the sparse points' depths."""

UNKNOWN_NEAREST = 0.15
"""With too few sparse points, it starts at this share of the distance to the scene."""

MIN_POINTS = 20

WIDE_HYPOTHESES, WIDE_PIXELS = 64, 25_000
WIDENED = 1.5
"""Steps of the full-range sweep by which the range is extended beyond the depths found."""

PIXELS_PER_STEP = 0.7
"""Shift between neighbouring hypotheses, in pixels of the source view that shifts most."""

NEAREST_AN_OCTAVE, LIMITS_PER_STEP = 16, 16
"""The nearest depth of the full-range sweep is rounded to so many values per factor of 2, and limits within that range
to fractions of its steps, always outwards.

Devices that round otherwise, and so find slightly other points and depths, then test the same hypotheses. A shift by a
hundredth of a step changes depths by more than that, since it changes what is sampled.
"""

FEWEST, MOST = 48, 192
"""Minimum and maximum number of hypotheses of a sweep."""


@dataclass(frozen=True)
class DepthRange:
    """The depths that a sweep tests, evenly spaced in inverse depth.

    Attributes:
        nearest: minimum depth.
        farthest: maximum depth; infinite if objects are so far away that they hardly shift.
        hypotheses: number of depths.
    """

    nearest: float
    farthest: float
    hypotheses: int

    @property
    def inverse_depths(self) -> np.ndarray:
        """(D,) float32, ascending. Infinite depth counts as half a step from infinity."""
        if np.isfinite(self.farthest):
            return np.linspace(1 / self.farthest, 1 / self.nearest, self.hypotheses, dtype=np.float32)
        return ((np.arange(self.hypotheses) + 0.5) / (self.hypotheses - 0.5) / self.nearest).astype(np.float32)


def wide_range(frame: Frame, points: np.ndarray, distance: float) -> DepthRange:
    """All plausible depths: from well in front of the nearest sparse points to infinity.

    Args:
        frame: the keyframe.
        points: (N, 3) sparse points that it sees.
        distance: typical distance to the scene, for frames that see too few points.
    """
    depths = depths_of(frame, points)
    if len(depths) < MIN_POINTS:
        return DepthRange(UNKNOWN_NEAREST * distance, np.inf, WIDE_HYPOTHESES)
    nearest = NEAREST_SHARE * float(np.quantile(depths, NEAREST_QUANTILE))
    rounded = 2.0 ** (math.floor(NEAREST_AN_OCTAVE * math.log2(nearest)) / NEAREST_AN_OCTAVE)
    return DepthRange(rounded, np.inf, WIDE_HYPOTHESES)


def narrowed(wide: DepthRange, found: np.ndarray, frame: Frame, source_views: Sequence[Frame]) -> DepthRange:
    """The range of the depths found, with hypotheses as fine as the source views can resolve.

    Args:
        wide: the range of the first sweep.
        found: (N,) depths: confident ones of the first sweep, and those of sparse points.
        frame: the keyframe.
        source_views: its source views.
    """
    inverse = wide.inverse_depths
    step = float(inverse[1] - inverse[0])
    low, high = float(inverse[0]), float(inverse[-1])
    if len(found) >= MIN_POINTS:
        far, near = np.quantile(1 / found, QUANTILES)
        unit = step / LIMITS_PER_STEP
        low = max(low, unit * math.floor((float(far) - WIDENED * step) / unit))
        high = min(high, unit * math.ceil((float(near) + WIDENED * step) / unit))
    farthest = np.inf if low <= step else 1 / low
    baseline = max(
        (float(np.linalg.norm(other.camera.centre - frame.camera.centre)) for other in source_views), default=0
    )
    shift = (high - (0.0 if np.isinf(farthest) else low)) * baseline * max(frame.camera.fx, frame.camera.fy)
    return DepthRange(1 / high, farthest, int(np.clip(np.ceil(shift / PIXELS_PER_STEP), FEWEST, MOST)))


def depths_of(frame: Frame, points: np.ndarray) -> np.ndarray:
    """(M,) depths along the frame's optical axis of the (N, 3) points in front of it."""
    pose = frame.camera.world_to_camera
    depth = points @ pose[2, :3] + pose[2, 3]
    return depth[depth > 0]


def small_copy(frame: Frame) -> Frame:
    """The frame at the size of the full-range sweep."""
    reduction = np.sqrt(frame.camera.width * frame.camera.height / WIDE_PIXELS)
    return downscaled(frame, float(reduction), None) if reduction > 1 else frame
