"""Validation of refined poses: by points and views that took no part in the adjustment, and by the photographs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from pocketgs.geometry.camera import Camera
from pocketgs.prior.bundle.adjustment import BundleSettings, adjust_pose
from pocketgs.prior.features.observations import Observations
from pocketgs.prior.features.tracks import reprojection_errors, triangulate
from pocketgs.prior.poses.consensus import consensus
from pocketgs.prior.poses.photometric import correlations
from pocketgs.prior.poses.robust_adjustment import MIN_OBSERVATIONS, RobustAdjustment
from pocketgs.prior.poses.tolerance import MIN_ANGLE

CHECKED_SHARE = 3
"""One in so many points is held out from bundle adjustment, to validate it."""

LEFT_OUT_SHARE = 5
"""One in so many views is held out too: it is placed against the points that the others agree on."""

MIN_GAIN = 0.1
"""Minimum relative decrease of the error of held-out points for new poses to be accepted.

Poses computed from larger or more images are often better than what our features can tell, but refitting them still
lowers the error of the points that they are fitted to.
"""

MIN_VIEWS = 3
"""Minimum number of views in a connected component that is adjusted."""


def validated(adjustment: RobustAdjustment, tracks: Observations, images: Sequence[np.ndarray]) -> np.ndarray:
    """Which cameras belong to components that adjusted poses explain better.

    A third of the points and a fifth of the views are held out from an adjustment made for this purpose. Adjusted poses
    are better if held-out points are seen where the other views say, if held-out views fit the points of the others at
    least as well, and if photographs look no less alike around held-out points.

    Args:
        adjustment: of F cameras.
        tracks: observations sorted by point, including wrong ones.
        images: F (H, W, 3) uint8, of the cameras' sizes.

    Returns:
        (F,) bool.
    """
    given, checked = adjustment.given, tracks.point % CHECKED_SHARE == 0
    absent = np.arange(len(given)) % LEFT_OUT_SHARE == LEFT_OUT_SHARE // 2
    adjusted = adjustment.adjusted(tracks.select(~checked & ~absent[tracks.frame]).renumbered())
    present, tolerance = adjusted.supported, adjusted.tolerance
    # Absent views keep their given poses while the others move: where they see points tells nothing about either.
    held_out = tracks.select(checked & present[tracks.frame]).renumbered()
    fitted = tracks.select(~checked)
    poses = given, adjusted.cameras
    by_points = [_PointFit.under(cameras, held_out, tolerance) for cameras in poses]
    by_views = [_errors_of_views(cameras, fitted, absent, tolerance, adjustment.settings) for cameras in poses]
    accepted = np.zeros(len(given), bool)
    for part in _parts(tracks, present | absent):
        if (part & present).sum() < MIN_VIEWS:
            continue
        good = _good([fit.errors for fit in by_points], part[held_out.frame], tolerance)
        before, after = _truncated([fit.errors for fit in by_points], good, tolerance)
        good_in_views = _good(by_views, part[fitted.frame], tolerance)
        views_before, views_after = _truncated(by_views, good_in_views, tolerance)
        # Without points to judge by, errors are NaN and nothing is accepted; views and photographs only confirm.
        if not after <= (1 - MIN_GAIN) * before or views_after > views_before:
            continue
        alike_before, alike_after = _mean_likeness(poses, images, held_out, [fit.points for fit in by_points], good)
        if not alike_after < alike_before:
            accepted |= part
    return accepted


class _PointFit(NamedTuple):
    """How well M observations fit the points that two or more other observations of their tracks agree on.

    Attributes:
        errors: (M,) distances in pixels; infinite without such a point.
        points: (M, 3) the points; NaN without one.
    """

    errors: np.ndarray
    points: np.ndarray

    @classmethod
    def under(cls, cameras: Sequence[Camera], tracks: Observations, tolerance: float) -> _PointFit:
        """The fit under some poses."""
        found = consensus(cameras, tracks, tolerance, MIN_ANGLE)
        agreed = found.support >= 2
        return cls(np.where(agreed, found.error, np.inf), np.where(agreed[:, None], found.others, np.nan))


def _good(errors: Sequence[np.ndarray], inside: np.ndarray, tolerance: float) -> np.ndarray:
    """(M,) bool: the observations that are good under either set of poses."""
    return np.asarray(inside & (np.minimum(*errors) < tolerance))


def _truncated(errors: Sequence[np.ndarray], good: np.ndarray, tolerance: float) -> tuple[float, float]:
    """RMS errors before and after, truncated at the tolerance, of the good observations; NaN for none."""
    if not good.any():
        return float("nan"), float("nan")
    before, after = (float(np.sqrt(np.mean(np.minimum(each[good], tolerance) ** 2))) for each in errors)
    return before, after


def _mean_likeness(
    poses: Sequence[Sequence[Camera]],
    images: Sequence[np.ndarray],
    tracks: Observations,
    points: Sequence[np.ndarray],
    good: np.ndarray,
) -> tuple[float, float]:
    """Mean likeness before and after, of the good observations where both are known; NaN for few, which are noise."""
    found = [
        correlations(cameras, images, tracks, np.where(good[:, None], each, np.nan))
        for cameras, each in zip(poses, points, strict=True)
    ]
    known = np.isfinite(found[0]) & np.isfinite(found[1])
    if known.sum() < MIN_OBSERVATIONS:
        return float("nan"), float("nan")
    before, after = (float(each[known].mean()) for each in found)
    return before, after


def _errors_of_views(
    cameras: Sequence[Camera], tracks: Observations, absent: np.ndarray, tolerance: float, settings: BundleSettings
) -> np.ndarray:
    """(M,) errors of the held-out views' observations, after placing each view by one half and judging by the other.

    The points are those that the other views agree on.
    """
    errors = np.full(len(tracks), np.inf)
    others = tracks.select(~absent[tracks.frame])
    numbers, theirs = np.unique(others.point), others.renumbered()
    theirs = theirs.select(consensus(cameras, theirs, tolerance, MIN_ANGLE).agrees)
    positions = np.full((int(tracks.point.max(initial=-1)) + 1, 3), np.nan)
    if len(theirs):
        found = triangulate(cameras, theirs)
        seen = np.bincount(theirs.point, minlength=len(found)) >= 2
        positions[numbers[: len(found)][seen]] = found[seen]
    known = np.isfinite(positions[tracks.point]).all(axis=1)
    for view in np.flatnonzero(absent).tolist():
        own = np.flatnonzero(tracks.frame == view)
        fitted, judged = (half[known[half]] for half in (own[::2], own[1::2]))  # the same halves under any poses
        if len(fitted) < MIN_OBSERVATIONS // 2:
            continue
        points, pixels = positions[tracks.point], tracks.pixels
        placed = adjust_pose(cameras[view], points[fitted], pixels[fitted], settings).camera
        observations = Observations.in_one_view(pixels[judged])
        errors[judged] = reprojection_errors([placed], points[judged], observations)
    return errors


def _parts(tracks: Observations, supported: np.ndarray) -> list[np.ndarray]:
    """(F,) bool each: connected components of cameras that share points, if large enough."""
    tracks = tracks.select(supported[tracks.frame])
    same = tracks.point[1:] == tracks.point[:-1]
    one, other = tracks.frame[:-1][same], tracks.frame[1:][same]
    graph = coo_matrix((np.ones(len(one)), (one, other)), shape=(len(supported), len(supported)))
    _, label = connected_components(graph, directed=False)
    return [(label == number) & supported for number in np.unique(label[supported])]
