"""Tracks: matches between pairs of views, linked across views and triangulated."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial.distance import cdist

from pocketgs.geometry.camera import Camera
from pocketgs.prior.features.features import Features
from pocketgs.prior.features.observations import Observations

WIDEST_AXES_ANGLE = np.radians(60)
"""Maximum angle between optical axes for SIFT matching."""

REWEIGHTINGS = 3


def view_distances(first: Sequence[Camera], second: Sequence[Camera], scene_distance: float) -> np.ndarray:
    """(F, S) distances between views: distance of centres relative to that to the scene, plus that of the axes."""

    def traits(cameras: Sequence[Camera]) -> tuple[np.ndarray, np.ndarray]:
        centres = np.array([camera.centre for camera in cameras]).reshape(-1, 3)
        return centres / scene_distance, np.array([camera.forward for camera in cameras]).reshape(-1, 3)

    (centres, forwards), (other_centres, other_forwards) = traits(first), traits(second)
    return np.asarray(cdist(centres, other_centres) + cdist(forwards, other_forwards))


def link(
    features: Sequence[Features], matches: Mapping[tuple[int, int], np.ndarray]
) -> tuple[Observations, np.ndarray]:
    """Link matches into tracks: connected features are observations of the same point.

    A track with two features in one view is dropped: one of its matches is wrong.

    Returns:
        The observations, sorted by point and frame, and (M,) int64 feature index of each in its frame.
    """
    starts = np.concatenate([[0], np.cumsum([len(view.pixels) for view in features])])
    edges = [np.add(pairs, (starts[first], starts[second])) for (first, second), pairs in matches.items()]
    joined = np.concatenate([np.zeros((0, 2), np.int64), *edges])
    graph = coo_matrix((np.ones(len(joined), bool), (joined[:, 0], joined[:, 1])), shape=(starts[-1], starts[-1]))
    _, label = connected_components(graph, directed=False)
    used = np.unique(joined)
    frame = np.searchsorted(starts, used, side="right") - 1
    label = label[used]
    in_frame = label.astype(np.int64) * len(features) + frame
    _, inverse, counts = np.unique(in_frame, return_inverse=True, return_counts=True)
    sound = ~np.isin(label, label[counts[inverse] > 1])
    used, frame, label = used[sound], frame[sound], label[sound]
    order = np.lexsort((frame, label))
    used, frame = used[order], frame[order]
    _, point = np.unique(label[order], return_inverse=True)
    feature = used - starts[frame]
    pixels = np.concatenate([np.zeros((0, 2)), *[view.pixels for view in features]])[used]
    return Observations(frame.astype(np.int32), point.astype(np.int32), pixels), feature


def triangulate(cameras: Sequence[Camera], observations: Observations) -> np.ndarray:
    """(N, 3) least-squares intersections of rays, weighted to minimise errors in pixels.

    Weights are updated a few times so that wrong rays lose influence. Points with parallel rays are not finite.
    """
    count = int(observations.point.max()) + 1 if len(observations.point) else 0
    centres, directions, focal = _rays(cameras, observations)
    across = np.eye(3) - directions[:, :, None] * directions[:, None, :]
    weights = np.ones(len(observations.point))
    points: np.ndarray = np.zeros((count, 3))
    for _ in range(REWEIGHTINGS):
        normal, right = np.zeros((count, 3, 3)), np.zeros((count, 3))
        weighted = across * weights[:, None, None]
        np.add.at(normal, observations.point, weighted)
        np.add.at(right, observations.point, np.einsum("mij,mj->mi", weighted, centres))
        degenerate = np.linalg.cond(normal) > 1e12
        normal[degenerate] = np.eye(3)
        points = np.linalg.solve(normal, right[:, :, None])[:, :, 0]
        points[degenerate] = np.nan
        offsets = points[observations.point] - centres
        distance = np.maximum(np.linalg.norm(offsets, axis=1), 1e-12)
        missed = np.linalg.norm(np.einsum("mij,mj->mi", across, offsets), axis=1) * focal / distance
        weights = np.nan_to_num((focal / distance) ** 2 / (1 + missed**2))
    return points


def _rays(cameras: Sequence[Camera], observations: Observations) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(M, 3) origins, (M, 3) unit directions and (M,) focal lengths of the observations' rays."""
    centres = np.array([camera.centre for camera in cameras])[observations.frame]
    rotations = np.array([camera.world_to_camera[:3, :3] for camera in cameras])[observations.frame]
    focal = np.array([(camera.fx, camera.fy) for camera in cameras])[observations.frame]
    middle = np.array([(camera.cx, camera.cy) for camera in cameras])[observations.frame]
    local = np.column_stack([(observations.pixels - middle) / focal, np.ones(len(focal))])
    directions = np.einsum("mji,mj->mi", rotations, local)
    return centres, directions / np.linalg.norm(directions, axis=1, keepdims=True), np.sqrt(focal.prod(axis=1))


def reprojection_errors(cameras: Sequence[Camera], points: np.ndarray, observations: Observations) -> np.ndarray:
    """(M,) reprojection errors in pixels; infinite behind the camera."""
    rotations = np.array([camera.world_to_camera[:3, :3] for camera in cameras])[observations.frame]
    offsets = np.array([camera.world_to_camera[:3, 3] for camera in cameras])[observations.frame]
    focal = np.array([(camera.fx, camera.fy) for camera in cameras])[observations.frame]
    middle = np.array([(camera.cx, camera.cy) for camera in cameras])[observations.frame]
    local = np.einsum("mij,mj->mi", rotations, points[observations.point]) + offsets
    with np.errstate(divide="ignore", invalid="ignore"):
        errors = np.linalg.norm(local[:, :2] / local[:, 2:] * focal + middle - observations.pixels, axis=1)
    return np.where(local[:, 2] > 0, errors, np.inf)


def triangulation_angles(cameras: Sequence[Camera], points: np.ndarray, observations: Observations) -> np.ndarray:
    """(N,) angle in radians spanned by a point's rays: twice the largest angle to their mean, a close approximation."""
    count = len(points)
    offsets = points[observations.point] - np.array([camera.centre for camera in cameras])[observations.frame]
    directions = offsets / np.maximum(np.linalg.norm(offsets, axis=1, keepdims=True), 1e-12)
    mean = np.zeros((count, 3))
    np.add.at(mean, observations.point, directions)
    mean /= np.maximum(np.linalg.norm(mean, axis=1, keepdims=True), 1e-12)
    cosine = np.clip(np.sum(directions * mean[observations.point], axis=1), -1.0, 1.0)
    angles = np.zeros(count)
    np.maximum.at(angles, observations.point, 2 * np.arccos(cosine))
    return angles
