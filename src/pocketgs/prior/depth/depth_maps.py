"""Depth maps of all keyframes: source views, depth range and plane sweep for each."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np

from pocketgs.capture.capture import Frame
from pocketgs.capture.even_choice import evenly_chosen
from pocketgs.prior.depth.depth_range import depths_of, narrowed, small_copy, wide_range
from pocketgs.prior.depth.sensor_depth import SURE_MARGIN, completed
from pocketgs.prior.depth.source_views import choose_source_views
from pocketgs.prior.depth.stereo import Stereo, StereoExtent
from pocketgs.prior.depth.sweep import MAX_PIXELS, DepthMap, SweepSettings, at_sweep_size

MAX_SWEPT_PIXELS = 16_000_000
"""Pixels of all keyframes together: with more keyframes, each is swept at a smaller size, which bounds the time."""

MIN_POINTS, MAX_POINTS = 20, 200
"""Minimum and maximum number of sparse points for choosing source views; with fewer, points on a grid are used."""

GRID = 5


def sweep_pixels(keyframes: int) -> int:
    """Maximum number of pixels to sweep per keyframe."""
    return min(MAX_PIXELS, MAX_SWEPT_PIXELS // max(keyframes, 1))


def stereo_extent(sizes: Iterable[tuple[int, int]], keyframes: int, settings: SweepSettings) -> StereoExtent:
    """What the depth maps of a capture will ask for.

    Args:
        sizes: width and height of the frames.
        keyframes: their number.
        settings: of the sweeps.
    """
    reduced = []
    for width, height in sizes:
        reduction = min(1.0, math.sqrt(sweep_pixels(keyframes) / (width * height)))
        reduced.append((math.ceil(width * reduction), math.ceil(height * reduction)))
    return StereoExtent.of(reduced, settings.source_views, keyframes)


def depth_maps(
    keyframes: Sequence[Frame],
    frames: Sequence[Frame],
    points: Sequence[np.ndarray],
    distance: float,
    settings: SweepSettings,
    stereo: Stereo,
) -> tuple[list[Frame], list[DepthMap]]:
    """Compute the depth maps of all keyframes, one after the other.

    Args:
        keyframes: K frames.
        frames: the training frames, including keyframes, to take source views from.
        points: for each keyframe, (N, 3) the sparse points that it sees.
        distance: typical distance to the scene.
        settings: of the sweeps.
        stereo: computes them.

    Returns:
        The keyframes at the size of their sweeps, and their depth maps.
    """
    most = sweep_pixels(len(keyframes))
    sized = {frame.name: at_sweep_size(frame, most) for frame in frames}
    found = [
        _depth_map(sized[keyframe.name], list(sized.values()), seen, distance, settings, stereo)
        for keyframe, seen in zip(keyframes, points, strict=True)
    ]
    return [sized[keyframe.name] for keyframe in keyframes], found


def _depth_map(
    keyframe: Frame,
    frames: Sequence[Frame],
    points: np.ndarray,
    distance: float,
    settings: SweepSettings,
    stereo: Stereo,
) -> DepthMap:
    source_views = choose_source_views(keyframe, frames, representative(keyframe, points, distance), settings)
    wide = wide_range(keyframe, points, distance)
    first = stereo.sweep(small_copy(keyframe), [small_copy(frame) for frame in source_views], wide, settings)
    sure = first.depth[(first.depth > 0) & (first.margin >= SURE_MARGIN)]
    search = narrowed(wide, np.concatenate([sure, depths_of(keyframe, points)]), keyframe, source_views)
    return completed(stereo.sweep(keyframe, source_views, search, settings), keyframe)


def representative(keyframe: Frame, points: np.ndarray, distance: float) -> np.ndarray:
    """(M, 3) points in the keyframe's view: some of its sparse points, or a grid at the typical distance."""
    if len(points) >= MIN_POINTS:
        return points[evenly_chosen(len(points), MAX_POINTS)]
    camera = keyframe.camera
    x, y = np.meshgrid((np.arange(GRID) + 0.5) * camera.width / GRID, (np.arange(GRID) + 0.5) * camera.height / GRID)
    return camera.centre + distance * camera.rays(np.stack([x.ravel(), y.ravel()], axis=1))
