"""Structure and motion of the keyframes: sparse points that several of them see, and poses that agree with them."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial

import numba
import numpy as np

from pocketgs.camera import Camera
from pocketgs.capture.capture import Frame
from pocketgs.errors import PocketGSError
from pocketgs.prior.bundle import BundleSettings, adjust_bundle
from pocketgs.prior.features import Features, detect
from pocketgs.prior.observations import Observations
from pocketgs.prior.scale import Scale
from pocketgs.prior.tracks import (
    link,
    match_views,
    overlapping_pairs,
    reprojection_errors,
    triangulate,
    triangulation_angles,
)

CHECKED_SHARE = 3
"""One in so many points is kept from bundle adjustment to judge it by."""

LEAST_GAIN = 0.1
"""Poses are replaced when that lowers the reprojection error of points they were not fitted to by this share, at least.

Poses that were computed from larger images, or from more of them, are often better than what features of small images
tell. Fitting poses anew lowers the error of the points that they are fitted to even then.
"""


@dataclass(frozen=True)
class StructureSettings:
    """How sparse points are found and poses refined.

    Attributes:
        bundle: adjust the poses; otherwise they stay as given and points are only triangulated.
        features: most features of a frame.
        position_sigma: standard deviation of given positions, in metres, or where the capture is not metric in units of
            the distance to the scene.
        rotation_sigma: that of given rotations, in radians.
        rounds: reprojection errors in pixels beyond which a sighting is left out, round by round. The first is wide,
            since given poses may be off by many pixels.
        least_angle: triangulation angle in radians below which a point is left out.
        fewest_points: fewer say too little to go by.
    """

    bundle: bool = True
    features: int = 2000
    position_sigma: float = 0.05
    rotation_sigma: float = np.radians(2)
    rounds: tuple[float, ...] = (16.0, 4.0, 2.0)
    least_angle: float = np.radians(1.5)
    fewest_points: int = 50

    def __post_init__(self) -> None:
        if self.features < 1:
            raise PocketGSError(f"features: found {self.features}, expected at least 1")

    def bundle_settings(self, scale: Scale) -> BundleSettings:
        """Those of bundle adjustment in a scene of this scale."""
        return BundleSettings(position_sigma=self.position_sigma * scale.unit, rotation_sigma=self.rotation_sigma)


@dataclass(frozen=True, eq=False)
class Structure:
    """Sparse points and the poses of the keyframes that see them.

    Attributes:
        cameras: of the K keyframes.
        points: (N, 3) float64.
        observations: where the keyframes see the points.
        landmarks: for each keyframe the features that are points, and (L,) the index of each one's point.
        rmse_before, rmse_after: root mean square reprojection error in pixels with the given poses, and with those in
            `cameras`.
        refined: whether `cameras` are other than given.
    """

    cameras: list[Camera]
    points: np.ndarray
    observations: Observations
    landmarks: list[tuple[Features, np.ndarray]]
    rmse_before: float
    rmse_after: float
    refined: bool


def detect_all(frames: Sequence[Frame], most: int) -> list[Features]:
    """Features of every frame, found on all cores."""
    with ThreadPoolExecutor(numba.get_num_threads()) as pool:
        return list(pool.map(partial(detect, most=most), frames))


def build_structure(keyframes: Sequence[Frame], scale: Scale, settings: StructureSettings) -> Structure | None:
    """Find points that several keyframes see, and refine the poses where the points contradict them.

    Args:
        keyframes: K frames with given poses.
        scale: of the scene.
        settings: how.

    Returns:
        None if there is too little texture to tell.
    """
    given = [frame.camera for frame in keyframes]
    features = detect_all(keyframes, settings.features)
    matches = match_views(given, features, overlapping_pairs(given, scale.distance))
    tracks, feature = link(features, matches)
    cameras, points = given, triangulate(given, tracks)
    for threshold in settings.rounds:
        trusted = _trusted(cameras, points, tracks, threshold, settings.least_angle)
        numbers, seen = _renumbered(tracks.select(trusted))
        if len(numbers) < settings.fewest_points:
            return None
        if settings.bundle:
            # Every round starts from the given poses: from the last round's, the prior would let them wander off.
            cameras = adjust_bundle(given, points[numbers], seen, settings.bundle_settings(scale)).cameras
            points = triangulate(cameras, tracks)
    refined = settings.bundle and _generalises(given, tracks, trusted, settings, scale)
    cameras = cameras if refined else given
    points = triangulate(cameras, seen)
    landmarks = [_landmarks(features[view], feature[trusted], seen, view) for view in range(len(keyframes))]
    before = _rmse(given, triangulate(given, seen), seen)
    return Structure(cameras, points, seen, landmarks, before, _rmse(cameras, points, seen), refined)


def _generalises(
    given: Sequence[Camera], tracks: Observations, trusted: np.ndarray, settings: StructureSettings, scale: Scale
) -> bool:
    """Whether poses adjusted to some of the trusted points suit the others better than the given poses do.

    The others are those that the given poses do not rule out, good or bad: to judge by trusted sightings would favour
    the poses that they were chosen with. Hence medians.
    """
    checked = tracks.point % CHECKED_SHARE == 0
    points = triangulate(given, tracks)
    finite = np.isfinite(points).all(axis=1)[tracks.point]
    numbers, fitted = _renumbered(tracks.select(trusted & ~checked & finite))
    plausible = _trusted(given, points, tracks, settings.rounds[0], settings.least_angle)
    others, unseen = _renumbered(tracks.select(plausible & checked))
    if min(len(numbers), len(others)) < settings.fewest_points // CHECKED_SHARE:
        return False
    adjusted = adjust_bundle(given, points[numbers], fitted, settings.bundle_settings(scale)).cameras
    before, after = (
        np.median(reprojection_errors(cameras, triangulate(cameras, unseen), unseen)) for cameras in (given, adjusted)
    )
    return bool(after <= (1 - LEAST_GAIN) * before)


def _rmse(cameras: Sequence[Camera], points: np.ndarray, observations: Observations) -> float:
    errors = reprojection_errors(cameras, points, observations)
    return float(np.sqrt(np.mean(errors[np.isfinite(errors)] ** 2)))


def _trusted(
    cameras: Sequence[Camera], points: np.ndarray, tracks: Observations, threshold: float, least_angle: float
) -> np.ndarray:
    """(M,) bool: sightings near where their point falls, of points that two views see from angles far enough apart."""
    near = reprojection_errors(cameras, points, tracks) < threshold
    views = np.bincount(tracks.point[near], minlength=len(points))
    angles = triangulation_angles(cameras, points, tracks.select(near))
    return near & ((views >= 2) & (angles >= least_angle))[tracks.point]


def _renumbered(observations: Observations) -> tuple[np.ndarray, Observations]:
    """The points that are seen, and the observations with these numbered from 0."""
    numbers, point = np.unique(observations.point, return_inverse=True)
    return numbers, Observations(observations.frame, point.astype(np.int32), observations.pixels)


def _landmarks(
    features: Features, feature: np.ndarray, observations: Observations, view: int
) -> tuple[Features, np.ndarray]:
    here = observations.frame == view
    chosen = feature[here]
    return Features(features.pixels[chosen], features.descriptors[chosen]), observations.point[here]
