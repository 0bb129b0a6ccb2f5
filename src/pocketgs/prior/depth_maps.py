"""Depth maps of all keyframes: source views, depth range and plane sweep for each."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from pocketgs.capture.capture import Frame
from pocketgs.prior.depth_range import depths_of, narrowed, small_copy, wide_range
from pocketgs.prior.sensor_depth import SURE_MARGIN, completed
from pocketgs.prior.source_views import choose_source_views
from pocketgs.prior.sweep import MAX_PIXELS, DepthMap, Sweeper, SweepExtent, SweepSettings, at_sweep_size, with_room

MAX_SWEPT_PIXELS = 16_000_000
"""Pixels of all keyframes together: with more keyframes, each is swept at a smaller size, which bounds the time."""

MIN_POINTS, MAX_POINTS = 20, 200
"""Minimum and maximum number of sparse points for choosing source views; with fewer, points on a grid are used."""

GRID = 5


@dataclass(frozen=True, eq=False)
class SweptKeyframes:
    """Keyframes with their depth.

    Attributes:
        frames: the keyframes at the size of their sweeps.
        maps: their depth maps.
        device: that computed them, "cpu" or "webgpu".
        warnings: for the user.
    """

    frames: list[Frame]
    maps: list[DepthMap]
    device: str
    warnings: tuple[str, ...]


def sweep_pixels(keyframes: int) -> int:
    """Maximum number of pixels to sweep per keyframe."""
    return min(MAX_PIXELS, MAX_SWEPT_PIXELS // max(keyframes, 1))


def depth_maps(
    keyframes: Sequence[Frame],
    frames: Sequence[Frame],
    points: Sequence[np.ndarray],
    distance: float,
    settings: SweepSettings,
    sweeper: Sweeper,
) -> SweptKeyframes:
    """Compute the depth maps of all keyframes, one after the other.

    Args:
        keyframes: K frames.
        frames: the training frames, including keyframes, to take source views from.
        points: for each keyframe, (N, 3) the sparse points that it sees.
        distance: typical distance to the scene.
        settings: of the sweeps.
        sweeper: computes them; the CPU's takes its place where its device has too little memory.
    """
    most = sweep_pixels(len(keyframes))
    sized = {frame.name: at_sweep_size(frame, most) for frame in frames}
    sweeper, warnings = with_room(sweeper, _extent(sized.values(), settings))
    found = [
        _depth_map(sized[keyframe.name], list(sized.values()), seen, distance, settings, sweeper)
        for keyframe, seen in zip(keyframes, points, strict=True)
    ]
    sweeper.release()
    return SweptKeyframes([sized[keyframe.name] for keyframe in keyframes], found, sweeper.name, warnings)


def _extent(frames: Iterable[Frame], settings: SweepSettings) -> SweepExtent:
    """The sweep of the frame with the most pixels."""
    largest = max((frame.camera for frame in frames), key=lambda camera: camera.width * camera.height)
    return SweepExtent(largest.width, largest.height, settings.source_views)


def _depth_map(
    keyframe: Frame,
    frames: Sequence[Frame],
    points: np.ndarray,
    distance: float,
    settings: SweepSettings,
    sweeper: Sweeper,
) -> DepthMap:
    source_views = choose_source_views(keyframe, frames, _representative(keyframe, points, distance), settings)
    wide = wide_range(keyframe, points, distance)
    first = sweeper.sweep(small_copy(keyframe), [small_copy(frame) for frame in source_views], wide, settings)
    sure = first.depth[(first.depth > 0) & (first.margin >= SURE_MARGIN)]
    search = narrowed(wide, np.concatenate([sure, depths_of(keyframe, points)]), keyframe, source_views)
    return completed(sweeper.sweep(keyframe, source_views, search, settings), keyframe)


def _representative(keyframe: Frame, points: np.ndarray, distance: float) -> np.ndarray:
    """(M, 3) points in the keyframe's view: some of its sparse points, or a grid at the typical distance."""
    if len(points) >= MIN_POINTS:
        return points[np.linspace(0, len(points) - 1, min(len(points), MAX_POINTS)).astype(np.int64)]
    camera = keyframe.camera
    x, y = np.meshgrid((np.arange(GRID) + 0.5) * camera.width / GRID, (np.arange(GRID) + 0.5) * camera.height / GRID)
    return camera.centre + distance * camera.rays(np.stack([x.ravel(), y.ravel()], axis=1))
