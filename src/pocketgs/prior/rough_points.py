"""Rough points: what frames see where neither features nor a cloud say so, from full-range sweeps of small copies."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pocketgs.capture.capture import Frame
from pocketgs.capture.even_choice import evenly_chosen
from pocketgs.prior.depth.depth_maps import representative, stereo_extent
from pocketgs.prior.depth.depth_range import small_copy, wide_range
from pocketgs.prior.depth.room import with_room
from pocketgs.prior.depth.sensor_depth import SURE_MARGIN
from pocketgs.prior.depth.source_views import choose_source_views
from pocketgs.prior.depth.stereo import Stereo
from pocketgs.prior.depth.sweep import SweepSettings
from pocketgs.prior.seen_points import MAX_SEEN


def rough_points(frames: Sequence[Frame], distance: float, settings: SweepSettings, stereo: Stereo) -> list[np.ndarray]:
    """For each frame, (N, 3) some of the points that a sweep of a small copy is sure of.

    Args:
        frames: any frames.
        distance: typical distance to the scene, by which source views and the nearest depth are chosen.
        settings: of the sweeps.
        stereo: computes depth; the CPU takes its place if it has too little memory.
    """
    small = [small_copy(frame) for frame in frames]
    extent = stereo_extent([(frame.camera.width, frame.camera.height) for frame in small], 1, settings)
    stereo, _ = with_room(stereo, extent)
    found, unknown = [], np.zeros((0, 3))
    for frame in small:
        source_views = choose_source_views(frame, small, representative(frame, unknown, distance), settings)
        map_ = stereo.sweep(frame, source_views, wide_range(frame, unknown, distance), settings)
        rows, columns = np.nonzero((map_.depth > 0) & (map_.margin >= SURE_MARGIN))
        some = evenly_chosen(len(rows), MAX_SEEN)
        rows, columns = rows[some], columns[some]
        depths = map_.depth[rows, columns].astype(np.float64)
        rays = frame.camera.rays(np.column_stack([columns, rows]) + 0.5)
        found.append(frame.camera.centre + rays * depths[:, None])
    return found
