"""Completion: points where training views show something that no depth map covers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from pocketgs.capture.capture import Frame
from pocketgs.capture.even_choice import evenly_chosen
from pocketgs.prior.cloud.coverage import ViewCells, point_radii
from pocketgs.scene.point_cloud import PointCloud

MISSING_SHARE = 0.5
"""A point of another source is used if this share of the views that show it have no depth there."""

GUESSED_CONFIDENCE = 0.05

MAX_ADDED_SHARE = 0.3
"""Maximum share of added points in the cloud, unless fusion leaves more room."""


MAX_SOURCE = 1_000_000
"""Maximum number of points of a source to look at, spread evenly: all of them are projected into every view.

A capture's own cloud may be a scan of tens of millions of points.
"""


@dataclass(frozen=True, eq=False)
class Completion:
    """Points for the uncovered parts of the training views.

    Attributes:
        added: the points.
        known: share of the training pixels that points of known depth cover, including the cloud's.
        covered: share that the cloud and the added points cover together.
        guessed: number of added points with guessed depth.
    """

    added: PointCloud
    known: float
    covered: float
    guessed: int


def completion(
    cloud: PointCloud, frames: Sequence[Frame], sources: Sequence[PointCloud], distance: float, count: int
) -> Completion:
    """Find points for what training views show and the cloud does not cover.

    First come points of other sources, such as triangulated features and the capture's own cloud, where the views that
    show them lack coverage. Remaining holes get the interpolated depth of their surroundings in the view.

    Args:
        cloud: of fused depths.
        frames: training frames.
        sources: other points, best first.
        distance: depth for views without any known depth.
        count: maximum number of points of the whole cloud.
    """
    views = ViewCells.of(frames)
    depths = views.empty()
    views.cover(depths, cloud, point_radii(cloud.positions))
    room = max(int(MAX_ADDED_SHARE * count), count - len(cloud))
    found: list[PointCloud] = []
    for source in (each.select(evenly_chosen(len(each), MAX_SOURCE)) for each in sources):
        missing = np.flatnonzero(views.uncovered_share(depths, source.positions.astype(np.float64)) > MISSING_SHARE)
        more = source.select(missing[evenly_chosen(len(missing), room)])
        views.cover(depths, more, point_radii(more.positions))
        found.append(more)
        room -= len(more)
    known = views.share(depths)
    guessed = _guessed(views, depths, distance)
    guessed = guessed.select(evenly_chosen(len(guessed), room))
    views.cover(depths, guessed, point_radii(guessed.positions))
    return Completion(joined([*found, guessed]), known, views.share(depths), len(guessed))


def _guessed(views: ViewCells, depths: np.ndarray, distance: float) -> PointCloud:
    """Points for uncovered cells, at depths interpolated from their surroundings."""
    depths = depths.copy()
    bare = [np.count_nonzero(views.usable[view] & ~np.isfinite(depths[view])) for view in range(len(depths))]
    found: list[PointCloud] = []
    for view in np.argsort(bare, kind="stable")[::-1]:
        rows, columns = np.nonzero(views.usable[view] & ~np.isfinite(depths[view]))
        if len(rows) == 0:
            continue
        depth = _filled(depths[view], views.sizes[view], distance)[rows, columns]
        fx, fy, cx, cy = views.intrinsics[view]
        local = np.stack([(columns + 0.5 - cx) / fx, (rows + 0.5 - cy) / fy, np.ones(len(rows))], axis=1)
        rays = local @ views.rotations[view]
        away = -rays / np.linalg.norm(rays, axis=1, keepdims=True)
        colours = views.colours[view][rows, columns] / np.float32(255)
        confidences = np.full(len(rows), GUESSED_CONFIDENCE)
        points = PointCloud(views.centres[view] + rays * depth[:, None], colours, away, confidences)
        views.cover(depths, points, depth / fx)
        found.append(points)
    return joined(found)


def _filled(depths: np.ndarray, size: np.ndarray, distance: float) -> np.ndarray:
    """(R, C) float64 depths with the unknown ones interpolated in inverse depth, smoothly, from coarse to fine."""
    rows, columns = size
    known = np.isfinite(depths[:rows, :columns])
    if not known.any():
        return np.full(depths.shape, distance)
    inverse = np.where(known, 1 / np.where(known, depths[:rows, :columns], 1.0), 0.0).astype(np.float32)
    result = np.ones(depths.shape)
    result[:rows, :columns] = 1 / np.maximum(_pulled(inverse, known.astype(np.float32)), 1e-30)
    return result


def _pulled(values: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Pull-push interpolation: values where weights are 1, elsewhere from a smaller copy (Gortler et al. 1996)."""
    rows, columns = values.shape
    if rows * columns == 1 or weights.all():
        return values
    half = (max(1, (columns + 1) // 2), max(1, (rows + 1) // 2))
    mass = cv2.resize(weights, half, interpolation=cv2.INTER_AREA)
    mean = cv2.resize(values * weights, half, interpolation=cv2.INTER_AREA) / np.maximum(mass, 1e-9)
    coarse = _pulled(mean, (mass > 0).astype(np.float32))
    smooth = cv2.resize(coarse, (columns, rows), interpolation=cv2.INTER_LINEAR)
    return np.where(weights > 0, values, smooth)


def joined(clouds: Sequence[PointCloud]) -> PointCloud:
    """Concatenate clouds. Missing directions become 0, missing confidences 1."""
    if not clouds:
        return PointCloud(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0))

    def directions(cloud: PointCloud) -> np.ndarray:
        return np.zeros((len(cloud), 3), np.float32) if cloud.directions is None else cloud.directions

    def confidences(cloud: PointCloud) -> np.ndarray:
        return np.ones(len(cloud), np.float32) if cloud.confidences is None else cloud.confidences

    return PointCloud(
        np.concatenate([cloud.positions for cloud in clouds]),
        np.concatenate([cloud.colours for cloud in clouds]),
        np.concatenate([directions(cloud) for cloud in clouds]),
        np.concatenate([confidences(cloud) for cloud in clouds]),
    )
