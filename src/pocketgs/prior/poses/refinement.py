"""Pose refinement: bundle adjustment over all frames, accepted only if it explains held-out points and views better."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from pocketgs.geometry.camera import Camera
from pocketgs.prior.bundle.adjustment import BundleSettings, adjust_bundle, adjust_pose
from pocketgs.prior.bundle.equations import Adjuster
from pocketgs.prior.features.observations import Observations, enough_for_each_view
from pocketgs.prior.features.tracks import reprojection_errors, triangulate, view_distances
from pocketgs.prior.poses.consensus import consensus
from pocketgs.prior.poses.support import well_supported
from pocketgs.prior.poses.tolerance import MIN_ANGLE, next_tolerance

CHECKED_SHARE = 3
"""One in so many points is held out from bundle adjustment, to validate it."""

LEFT_OUT_SHARE = 5
"""One in so many views is held out too: it is placed against the points that the others agree on."""

MIN_GAIN = 0.1
"""Minimum relative decrease of the error of held-out points for new poses to be accepted.

Poses computed from larger or more images are often better than what our features can tell, but refitting them still
lowers the error of the points that they are fitted to.
"""

ROUNDS = 4
OBSERVATIONS_PER_VIEW = 250
"""Points are added, those seen by most views first, until every view has this many observations."""

MIN_OBSERVATIONS = 30
"""A view with fewer observations, or with less well spread ones, is not adjusted but follows its neighbours."""

MIN_VIEWS = 3
"""Minimum number of views in a connected component that is adjusted."""


@dataclass(frozen=True)
class Refinement:
    """The result of refinement for F cameras.

    Attributes:
        cameras: refined where accepted, otherwise as given.
        moved: (F,) bool: refined.
        carried: (F,) bool: sees too few points, and was moved with the nearest refined camera.
    """

    cameras: list[Camera]
    moved: np.ndarray
    carried: np.ndarray


def refine(
    given: Sequence[Camera],
    tracks: Observations,
    tolerance: float,
    finest: float,
    settings: BundleSettings,
    scene_distance: float,
    adjuster: Adjuster,
) -> Refinement:
    """Adjust poses, component by component, and keep those that pass validation.

    Args:
        given: F cameras.
        tracks: observations sorted by point, including wrong ones.
        tolerance: maximum error of an observation under the given poses, in pixels.
        finest: errors below this many pixels are noise.
        settings: of bundle adjustment.
        scene_distance: typical distance to the scene.
        adjuster: makes the normal equations.
    """
    nothing = Refinement(list(given), np.zeros(len(given), bool), np.zeros(len(given), bool))
    accepted = _accepted(given, tracks, tolerance, finest, settings, adjuster)
    if not accepted.any():
        return nothing
    adjusted, supported, _ = _adjusted(given, tracks, tolerance, finest, settings, adjuster)
    moved = accepted & supported
    if not moved.any():
        return nothing
    cameras = [new if move else old for old, new, move in zip(given, adjusted, moved, strict=True)]
    carried = _thin(given, moved, supported, scene_distance)
    for view in np.flatnonzero(carried).tolist():
        nearest = _nearest(given[view], given, moved, scene_distance)
        cameras[view] = carried_along(given[view], given[nearest], adjusted[nearest])
    return Refinement(cameras, moved, carried)


def carried_along(camera: Camera, given: Camera, refined: Camera) -> Camera:
    """The camera, keeping its given pose relative to another camera that has been refined."""
    relative = camera.world_to_camera @ given.camera_to_world
    return replace(camera, world_to_camera=relative @ refined.world_to_camera)


def _adjusted(
    given: Sequence[Camera],
    tracks: Observations,
    tolerance: float,
    finest: float,
    settings: BundleSettings,
    adjuster: Adjuster,
) -> tuple[list[Camera], np.ndarray, float]:
    """Cameras adjusted to the consistent observations, which of them see enough, and the final tolerance."""
    cameras, supported = list(given), np.zeros(len(given), bool)
    for _ in range(ROUNDS):
        agreeing = tracks.select(consensus(cameras, tracks, tolerance, MIN_ANGLE).agrees)
        chosen, supported = _well_seen(given, agreeing)
        if not supported.any():
            return list(given), supported, tolerance
        seen = chosen.renumbered()
        points = triangulate(cameras, seen)
        finite = np.isfinite(points).all(axis=1)
        seen = seen.select(finite[seen.point]).renumbered()
        result = adjust_bundle(given, points[finite], seen, settings, start=cameras, adjuster=adjuster)
        cameras = [new if own else old for old, new, own in zip(given, result.cameras, supported, strict=True)]
        last, tolerance = tolerance, next_tolerance(result.residuals, tolerance, finest)
        if tolerance > 0.8 * last:
            break
    return cameras, supported, tolerance


def _accepted(
    given: Sequence[Camera],
    tracks: Observations,
    tolerance: float,
    finest: float,
    settings: BundleSettings,
    adjuster: Adjuster,
) -> np.ndarray:
    """(F,) bool: cameras in components that refined poses explain better.

    Validated with points and views held out from an adjustment made for this purpose.
    """
    checked = tracks.point % CHECKED_SHARE == 0
    absent = np.arange(len(given)) % LEFT_OUT_SHARE == LEFT_OUT_SHARE // 2
    fitted = tracks.select(~checked & ~absent[tracks.frame]).renumbered()
    adjusted, present, final = _adjusted(given, fitted, tolerance, finest, settings, adjuster)
    by_points = [_errors_of_points(cameras, tracks.select(checked), final) for cameras in (given, adjusted)]
    by_views = [
        _errors_of_views(cameras, tracks.select(~checked), absent, final, settings) for cameras in (given, adjusted)
    ]
    accepted = np.zeros(len(given), bool)
    for part in _parts(tracks, present | absent):
        if (part & present).sum() < MIN_VIEWS:
            continue
        inside = part[tracks.frame[checked]] & present[tracks.frame[checked]]
        before, after = (_truncated(by_points, inside, final, which) for which in (0, 1))
        views_before, views_after = (
            _truncated(by_views, part[tracks.frame[~checked]], final, which) for which in (0, 1)
        )
        # Without points to judge by, errors are NaN and nothing is accepted; views only confirm.
        if after <= (1 - MIN_GAIN) * before and not views_after > views_before:
            accepted |= part
    return accepted


def _truncated(errors: Sequence[np.ndarray], inside: np.ndarray, tolerance: float, which: int) -> float:
    """RMS error, truncated at the tolerance, of observations that are good under either set of poses; NaN for none."""
    either = inside & ((errors[0] < tolerance) | (errors[1] < tolerance))
    if not either.any():
        return float("nan")
    return float(np.sqrt(np.mean(np.minimum(errors[which][either], tolerance) ** 2)))


def _errors_of_points(cameras: Sequence[Camera], tracks: Observations, tolerance: float) -> np.ndarray:
    """(M,) distance of observations from the point that two or more others agree on; infinite without one."""
    found = consensus(cameras, tracks.renumbered(), tolerance, MIN_ANGLE)
    return np.where(found.support >= 2, found.error, np.inf)


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
    positions = np.full((int(tracks.point.max()) + 1, 3), np.nan)
    if len(theirs):
        found = triangulate(cameras, theirs)
        seen = np.bincount(theirs.point, minlength=len(found)) >= 2
        positions[numbers[: len(found)][seen]] = found[seen]
    known = np.isfinite(positions[tracks.point]).all(axis=1)
    for view in np.flatnonzero(absent).tolist():
        own = np.flatnonzero((tracks.frame == view) & known)
        fitted, judged = own[::2], own[1::2]
        if len(fitted) < MIN_OBSERVATIONS // 2:
            continue
        points, pixels = positions[tracks.point], tracks.pixels
        placed = adjust_pose(cameras[view], points[fitted], pixels[fitted], settings).camera
        observations = Observations.in_one_view(pixels[judged])
        errors[judged] = reprojection_errors([placed], points[judged], observations)
    return errors


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


def _parts(tracks: Observations, supported: np.ndarray) -> list[np.ndarray]:
    """(F,) bool each: connected components of cameras that share points, if large enough."""
    tracks = tracks.select(supported[tracks.frame])
    same = tracks.point[1:] == tracks.point[:-1]
    one, other = tracks.frame[:-1][same], tracks.frame[1:][same]
    graph = coo_matrix((np.ones(len(one)), (one, other)), shape=(len(supported), len(supported)))
    _, label = connected_components(graph, directed=False)
    return [(label == number) & supported for number in np.unique(label[supported])]


def _thin(given: Sequence[Camera], moved: np.ndarray, supported: np.ndarray, scene_distance: float) -> np.ndarray:
    """(F,) bool: cameras that see too few points, and whose nearest well-supported neighbour has moved."""
    thin = np.zeros(len(given), bool)
    for view in np.flatnonzero(~supported).tolist():
        thin[view] = moved[_nearest(given[view], given, supported, scene_distance)]
    return thin


def _nearest(camera: Camera, others: Sequence[Camera], among: np.ndarray, scene_distance: float) -> int:
    numbers = np.flatnonzero(among).tolist()
    distances = view_distances([camera], [others[number] for number in numbers], scene_distance)[0]
    return int(numbers[int(distances.argmin())])
