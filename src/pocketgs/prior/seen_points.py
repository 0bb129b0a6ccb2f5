"""Which points of a cloud the frames see, where no features say so."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pocketgs.capture.capture import Frame
from pocketgs.capture.even_choice import evenly_chosen
from pocketgs.prior.cloud.coverage import ViewCells, point_radii
from pocketgs.scene.point_cloud import PointCloud

MAX_POINTS, MAX_SEEN = 50_000, 2_000
"""Maximum number of points to look at, and of points to return for each frame: both are spread evenly."""

HIDDEN = 1.5
"""A point is occluded if the cloud's nearest point in its cell is nearer by this factor."""


def seen_points(cloud: PointCloud, frames: Sequence[Frame]) -> list[np.ndarray]:
    """For each frame, (N, 3) the points of a cloud that it sees: in the image, not masked, and not occluded.

    Args:
        cloud: in the world of the frames.
        frames: any frames.
    """
    cloud = cloud.select(evenly_chosen(len(cloud), MAX_POINTS))
    views = ViewCells.of(frames)
    nearest = views.empty()
    views.cover(nearest, cloud, point_radii(cloud.positions))
    found = []
    for view in range(len(frames)):
        inside, cells, depth = views.cells_of(view, cloud.positions)
        unhidden = views.usable[view][cells] & (depth < HIDDEN * nearest[view][cells])
        seen = cloud.positions[inside][unhidden]
        found.append(seen[evenly_chosen(len(seen), MAX_SEEN)])
    return found
