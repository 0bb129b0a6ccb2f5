"""Bundle adjustment to tracks with wrong observations: rounds of consensus and adjustment, with a falling tolerance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pocketgs.geometry.camera import Camera
from pocketgs.prior.bundle.adjustment import BundleSettings, adjust_bundle
from pocketgs.prior.bundle.equations import Linearizer
from pocketgs.prior.features.observations import Observations, enough_for_each_view
from pocketgs.prior.features.tracks import triangulate
from pocketgs.prior.poses.consensus import consensus
from pocketgs.prior.poses.support import well_supported
from pocketgs.prior.poses.tolerance import MIN_ANGLE, next_tolerance

ROUNDS = 4
OBSERVATIONS_PER_VIEW = 250
"""Points are added, those seen by most views first, until every view has this many observations."""

MIN_OBSERVATIONS = 30
"""A view with fewer observations, or with less well spread ones, is not adjusted."""


@dataclass(frozen=True)
class Adjusted:
    """The result of an adjustment of F cameras.

    Attributes:
        cameras: adjusted where supported, otherwise as given.
        supported: (F,) bool: sees enough points.
        tolerance: maximum error of an observation under the new poses, in pixels.
    """

    cameras: list[Camera]
    supported: np.ndarray
    tolerance: float


@dataclass(frozen=True)
class RobustAdjustment:
    """How cameras are adjusted.

    Attributes:
        given: the cameras.
        tolerance: maximum error of an observation under the given poses, in pixels.
        finest: errors below this many pixels are noise.
        settings: of bundle adjustment.
        linearizer: makes the normal equations.
    """

    given: Sequence[Camera]
    tolerance: float
    finest: float
    settings: BundleSettings
    linearizer: Linearizer

    def adjusted(self, tracks: Observations) -> Adjusted:
        """Adjust the cameras to those of the observations that agree.

        Args:
            tracks: observations sorted by point, including wrong ones.
        """
        cameras, supported, tolerance = list(self.given), np.zeros(len(self.given), bool), self.tolerance
        for _ in range(ROUNDS):
            agreeing = tracks.select(consensus(cameras, tracks, tolerance, MIN_ANGLE).agrees)
            chosen, supported = _well_seen(self.given, agreeing)
            if not supported.any():
                return Adjusted(list(self.given), supported, tolerance)
            seen = chosen.renumbered()
            points = triangulate(cameras, seen)
            finite = np.isfinite(points).all(axis=1)
            seen = seen.select(finite[seen.point]).renumbered()
            result = adjust_bundle(
                self.given, points[finite], seen, self.settings, start=cameras, linearizer=self.linearizer
            )
            cameras = [new if own else old for old, new, own in zip(self.given, result.cameras, supported, strict=True)]
            last, tolerance = tolerance, next_tolerance(result.residuals, tolerance, self.finest)
            if tolerance > 0.8 * last:
                break
        return Adjusted(cameras, supported, tolerance)


def _well_seen(cameras: Sequence[Camera], tracks: Observations) -> tuple[Observations, np.ndarray]:
    """Enough observations to adjust by, and (F,) bool which cameras have enough of them, well spread."""
    supported = np.ones(len(cameras), bool)
    while True:
        tracks = tracks.select(supported[tracks.frame])
        views = np.bincount(tracks.point, minlength=1)
        tracks = tracks.select(views[tracks.point] >= 2)
        enough = supported & well_supported(cameras, tracks, MIN_OBSERVATIONS)
        if np.array_equal(enough, supported):
            break
        supported = enough
    return tracks.select(enough_for_each_view(tracks, len(cameras), OBSERVATIONS_PER_VIEW)), supported
