"""Reader of point clouds in .ply files."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pocketgs.capture.poses import MAX_COORDINATE
from pocketgs.errors import PocketGSError
from pocketgs.files.memory_bound import require_memory
from pocketgs.files.ply_file import read_vertices
from pocketgs.scene.point_cloud import PointCloud

MOST_POINTS = 3_000_000
"""Of larger clouds, such as scans, every n-th point is read, so that these are no more: later stages look at fewer."""

POINT_BYTES = 120
"""Memory per point while a cloud is read."""

UNKNOWN_COLOUR = 0.5
LARGEST_FRACTION = 2.0
"""Float colours are fractions up to here: interpolation may exceed 1 by a little."""


def read_cloud(path: Path) -> PointCloud | None:
    """Read the vertices of a .ply file with fields x, y, z and optionally red, green, blue; None if there are none.

    At most `MOST_POINTS` are read.

    Bytes of colours are 0 to 255, larger integers up to their type's maximum, floats 0 to 1; values that are all below
    256 are 0 to 255 in any type. Without colours, points are grey.

    Raises:
        PocketGSError: the file cannot be read, has no such vertices, exceeds the memory bound, or a coordinate is not
            finite or too large.
    """
    vertices = read_vertices(path)
    vertices = vertices[:: -(-len(vertices) // MOST_POINTS) or 1]
    require_memory(path, POINT_BYTES * len(vertices), f"a cloud of {len(vertices):,} points")
    try:
        positions = np.stack([vertices[axis] for axis in "xyz"], axis=1).astype(np.float64)
    except (ValueError, TypeError) as error:
        raise PocketGSError(f"{path}: not a point cloud ({error}), expected vertices with x, y, z") from error
    if len(positions) == 0:
        return None
    if not np.all(np.abs(positions) < MAX_COORDINATE):
        raise PocketGSError(f"{path}: holds NaN or coordinates beyond {MAX_COORDINATE:g}")
    return PointCloud(positions, _colours(vertices))


def _colours(vertices: np.ndarray) -> np.ndarray:
    names = ("red", "green", "blue")
    if not all(name in (vertices.dtype.names or ()) for name in names):
        return np.full((len(vertices), 3), UNKNOWN_COLOUR)
    colours = np.stack([vertices[name] for name in names], axis=1)
    return np.clip(np.nan_to_num(colours / _full(colours)), 0, 1)


def _full(colours: np.ndarray) -> float:
    """What full colour is in numbers of this type."""
    most = np.max(colours, initial=0, where=np.isfinite(colours))
    if colours.dtype.kind == "f":
        return 255.0 if most > LARGEST_FRACTION else 1.0
    return 255.0 if most <= 255 else float(np.iinfo(colours.dtype).max)
