"""Numbers of the tree of boxes that shaders and host share, and the memory that it takes."""

from __future__ import annotations

from pocketgs.gpu.sizes import ceil_div
from pocketgs.seeding.neighbourhoods import PLANE_NEIGHBOURS

LEAF = 8
"""Points in a leaf of the tree."""

MOST_NEIGHBOURS = PLANE_NEIGHBOURS + 1
"""A point's nearest neighbours, itself included."""

BOX_BYTES = 32

LARGEST_BYTES = 4 * MOST_NEIGHBOURS
"""Bytes per point of the largest buffer, the neighbours."""

POINT_BYTES = LARGEST_BYTES + 40 + 4 * BOX_BYTES // LEAF
"""Bytes per point of all buffers: there are fewer than two leaves for LEAF points, and two boxes for a leaf."""


def numbers_of(points: int) -> dict[str, int]:
    """The fields of `shaders/common/tree.wgsl` for so many points."""
    leaves = 1 << (ceil_div(points, LEAF) - 1).bit_length()
    return {"points": points, "neighbours": min(MOST_NEIGHBOURS, points), "leaves": leaves}
