"""Completion: points for what the training views see and no depth map tells."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from pocketgs.capture.capture import Frame
from pocketgs.pointcloud import PointCloud
from pocketgs.prior.coverage import ViewCells, point_radii

MISSING_SHARE = 0.5
"""A point of another source is taken if so many of the views that show it have nothing there."""

GUESSED_CONFIDENCE = 0.05

MOST_GUESSED = 0.3
"""Share of the cloud that may be guessed."""


@dataclass(frozen=True, eq=False)
class Completed:
    """A cloud that explains what the training views see.

    Attributes:
        cloud: all points.
        found: share of the training pixels that points of known depth cover.
        covered: share that the whole cloud covers.
        added: points taken from each further source.
        guessed: points whose depths are guessed from their surroundings.
    """

    cloud: PointCloud
    found: float
    covered: float
    added: tuple[int, ...]
    guessed: int


def completed(cloud: PointCloud, frames: Sequence[Frame], sources: Sequence[PointCloud], most: int) -> Completed:
    """Add points where views see something that the cloud does not explain.

    First points of other sources, such as triangulated features and the capture's own cloud, each where the views that
    show it lack something. What is left is given the depth of its surroundings in the view.

    Args:
        cloud: of fused depths.
        frames: training frames.
        sources: other points, the best first.
        most: points to add from each source, and to guess.
    """
    views = ViewCells.of(frames)
    depths = views.empty()
    views.cover(depths, cloud, point_radii(cloud.positions))
    added = []
    for source in sources:
        missing = views.uncovered_share(depths, source.positions.astype(np.float64)) > MISSING_SHARE
        chosen = np.flatnonzero(missing)
        chosen = chosen[np.linspace(0, len(chosen) - 1, min(most, len(chosen))).astype(np.int64)]
        extra = source.select(chosen)
        views.cover(depths, extra, point_radii(extra.positions))
        cloud = _joined(cloud, extra)
        added.append(len(extra))
    found = views.share(depths)
    guessed = _guessed(views, depths, most)
    return Completed(_joined(cloud, guessed), found, views.share(depths), tuple(added), len(guessed))


def _guessed(views: ViewCells, depths: np.ndarray, most: int) -> PointCloud:
    """Points for the cells that nothing covers, at the depths of what is around them; `depths` is brought up to date."""
    bare = [np.count_nonzero(views.usable[view] & ~np.isfinite(depths[view])) for view in range(len(depths))]
    found: list[PointCloud] = []
    for view in np.argsort(bare)[::-1]:
        here = views.usable[view] & ~np.isfinite(depths[view])
        if not here.any() or not np.isfinite(depths[view]).any():
            continue
        rows, columns = np.nonzero(here)
        depth = _filled(depths[view], views.sizes[view])[rows, columns]
        fx, fy, cx, cy = views.intrinsics[view]
        local = np.stack([(columns + 0.5 - cx) / fx, (rows + 0.5 - cy) / fy, np.ones(len(rows))], axis=1)
        rays = local @ views.rotations[view]
        positions = views.centres[view] + rays * depth[:, None]
        away = -rays / np.linalg.norm(rays, axis=1, keepdims=True)
        colours = views.colours[view][rows, columns] / np.float32(255)
        points = PointCloud(positions, colours, away, np.full(len(rows), GUESSED_CONFIDENCE))
        views.cover(depths, points, depth / fx)
        found.append(points)
    together = _together(found)
    if len(together) <= most:
        return together
    return together.select(np.sort(np.random.default_rng(0).permutation(len(together))[:most]))


def _filled(depths: np.ndarray, size: np.ndarray) -> np.ndarray:
    """(R, C) float64 depths with the unknown ones interpolated in inverse depth, smoothly, from coarse to fine."""
    rows, columns = size
    known = np.isfinite(depths[:rows, :columns])
    inverse = np.where(known, 1 / np.where(known, depths[:rows, :columns], 1.0), 0.0).astype(np.float32)
    result = np.ones(depths.shape)
    result[:rows, :columns] = 1 / np.maximum(_pulled(inverse, known.astype(np.float32)), 1e-30)
    return result


def _pulled(values: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Values where weights are 1, elsewhere the interpolation of a smaller copy (pull-push; Gortler et al. 1996)."""
    rows, columns = values.shape
    if rows * columns == 1 or weights.all():
        return values
    half = (max(1, (columns + 1) // 2), max(1, (rows + 1) // 2))
    mass = cv2.resize(weights, half, interpolation=cv2.INTER_AREA)
    mean = cv2.resize(values * weights, half, interpolation=cv2.INTER_AREA) / np.maximum(mass, 1e-9)
    coarse = _pulled(mean, (mass > 0).astype(np.float32))
    smooth = cv2.resize(coarse, (columns, rows), interpolation=cv2.INTER_LINEAR)
    return np.where(weights > 0, values, smooth)


def _joined(cloud: PointCloud, more: PointCloud) -> PointCloud:
    return _together([cloud, more])


def _together(clouds: Sequence[PointCloud]) -> PointCloud:
    """One cloud of several, which need not all have directions and confidences."""
    if not clouds:
        return PointCloud(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0))
    return PointCloud(
        np.concatenate([cloud.positions for cloud in clouds]),
        np.concatenate([cloud.colours for cloud in clouds]),
        np.concatenate(
            [np.zeros((len(cloud), 3)) if cloud.directions is None else cloud.directions for cloud in clouds]
        ),
        np.concatenate([np.ones(len(cloud)) if cloud.confidences is None else cloud.confidences for cloud in clouds]),
    )
