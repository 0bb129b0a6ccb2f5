"""Tracks: matches between pairs of views, linked into points that several views see, and where those points are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from pocketgs.camera import Camera
from pocketgs.prior.features import Features, agreeing, match
from pocketgs.prior.observations import Observations

WIDEST_ANGLE = np.radians(60)
"""Optical axes further apart see nothing that SIFT would recognise."""

PAIRS_PER_VIEW = 14
"""Each view is matched with at most so many others, those whose poses are most alike."""

POSE_TOLERANCE = 0.03
"""Distance from the given poses' epipolar lines that a match may have, as a share of the image's longer side.

Loose, because a phone's poses drift by degrees: what disagrees by more is not the fault of the poses.
"""

REWEIGHTINGS = 3

Matches = dict[tuple[int, int], np.ndarray]


def overlapping_pairs(cameras: Sequence[Camera], scene_distance: float) -> list[tuple[int, int]]:
    """Pairs of views that the poses say may see the same, each once, (first < second)."""
    forwards = np.array([camera.forward for camera in cameras])
    apart = view_distances(cameras, cameras, scene_distance)
    apart[forwards @ forwards.T < np.cos(WIDEST_ANGLE)] = np.inf
    np.fill_diagonal(apart, np.inf)
    pairs = set()
    for view, distances in enumerate(apart):
        for other in np.argsort(distances, kind="stable")[:PAIRS_PER_VIEW]:
            if np.isfinite(distances[other]):
                pairs.add((min(view, int(other)), max(view, int(other))))
    return sorted(pairs)


def view_distances(first: Sequence[Camera], second: Sequence[Camera], scene_distance: float) -> np.ndarray:
    """(F, S) how unlike the views of cameras are: distance of centres over that to the scene, plus that of the axes."""

    def traits(cameras: Sequence[Camera]) -> tuple[np.ndarray, np.ndarray]:
        centres = np.array([camera.centre for camera in cameras]).reshape(-1, 3)
        return centres / scene_distance, np.array([camera.forward for camera in cameras]).reshape(-1, 3)

    (centres, forwards), (other_centres, other_forwards) = traits(first), traits(second)
    apart = np.linalg.norm(centres[:, None] - other_centres, axis=2)
    return apart + np.linalg.norm(forwards[:, None] - other_forwards, axis=2)


def match_views(cameras: Sequence[Camera], features: Sequence[Features], pairs: Sequence[tuple[int, int]]) -> Matches:
    """Match pairs of views and keep what one motion explains that the given poses do not rule out.

    Returns:
        For every pair with matches left, (M, 2) int64 indices of features.
    """
    matches = {}
    for first, second in pairs:
        found = match(features[first], features[second])
        here, there = features[first].pixels[found[:, 0]], features[second].pixels[found[:, 1]]
        tolerance = POSE_TOLERANCE * max(cameras[second].width, cameras[second].height)
        plausible = epipolar_distance(cameras[first], cameras[second], here, there) < tolerance
        found, here, there = found[plausible], here[plausible], there[plausible]
        found = found[agreeing(here, there)]
        if len(found):
            matches[first, second] = found
    return matches


def epipolar_distance(first: Camera, second: Camera, here: np.ndarray, there: np.ndarray) -> np.ndarray:
    """(M,) distance in pixels of points in the second image from the epipolar lines of points in the first.

    Args:
        first: one camera.
        second: the other.
        here: (M, 2) pixels in the first image.
        there: (M, 2) pixels in the second.
    """
    relative = second.world_to_camera @ first.camera_to_world
    x, y, z = relative[:3, 3]
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    essential = cross @ relative[:3, :3]
    fundamental = np.linalg.inv(second.intrinsic_matrix).T @ essential @ np.linalg.inv(first.intrinsic_matrix)
    lines = np.column_stack([here, np.ones(len(here))]) @ fundamental.T
    distances = np.abs(np.sum(lines * np.column_stack([there, np.ones(len(there))]), axis=1))
    return distances / np.maximum(np.linalg.norm(lines[:, :2], axis=1), 1e-12)


def link(
    features: Sequence[Features], matches: Mapping[tuple[int, int], np.ndarray]
) -> tuple[Observations, np.ndarray]:
    """Join matches into tracks: features that are connected by matches are the same point.

    A track that meets a view twice is dropped: one of its matches is wrong.

    Returns:
        The observations, sorted by point and frame, and (M,) int64 the feature behind each in its frame.
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
    """(N, 3) points nearest to the rays that see them, in the least squares sense, weighted to be near in pixels.

    Reweighted a few times so that a wrong ray loses its say. A point whose rays are parallel is not finite.
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
    """(M,) distance in pixels between where points are seen and where they fall; infinite behind the camera."""
    rotations = np.array([camera.world_to_camera[:3, :3] for camera in cameras])[observations.frame]
    offsets = np.array([camera.world_to_camera[:3, 3] for camera in cameras])[observations.frame]
    focal = np.array([(camera.fx, camera.fy) for camera in cameras])[observations.frame]
    middle = np.array([(camera.cx, camera.cy) for camera in cameras])[observations.frame]
    local = np.einsum("mij,mj->mi", rotations, points[observations.point]) + offsets
    with np.errstate(divide="ignore", invalid="ignore"):
        errors = np.linalg.norm(local[:, :2] / local[:, 2:] * focal + middle - observations.pixels, axis=1)
    return np.where(local[:, 2] > 0, errors, np.inf)


def triangulation_angles(cameras: Sequence[Camera], points: np.ndarray, observations: Observations) -> np.ndarray:
    """(N,) angle in radians that a point's rays span: twice the largest from their mean, which is nearly that."""
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
