"""Ray tracing of the demo scene."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from pocketgs.capture.synthetic.shapes import Vector, dot, hit
from pocketgs.system.compile import part

TOWARDS_SUN = (0.48, -0.60, 0.64)
SUN_SPREAD = 0.03  # size of the sun's disc, as the difference of two directions across it

# A grid of square cells perpendicular to the sun's rays lists, per cell, the few parts that can cast shadows there.
SUN_ACROSS, SUN_UP = (
    (0.7808688094430304, 0.6246950475544243, 0.0),
    (-0.3998048304348315, 0.4997560380435394, 0.7683749084919418),
)
SUN_CELL, SUN_CELLS = 0.05, 128
SUN_REACH = 0.5 * SUN_CELL * SUN_CELLS


class Scene(NamedTuple):
    """Arrays of P parts and B occluding balls for the kernel.

    Attributes:
        shapes: (P,) int64, of `shapes.py`.
        tapers: (P,) of frustums.
        world_to_unit: (P, 3, 4) affine maps into the unit shapes' spaces.
        half_sizes: (P, 3) metres per unit of those spaces.
        materials: (P,) int64, of `materials.py`.
        paints: (P, 2, 3) light and dark colour, display-referred RGB in [0, 1].
        gloss: (P,) fraction of the light that is reflected head-on; 0 is matt.
        bounds: (P, 4) centre and radius of each part's bounding ball.
        dimming: (B, 4) centres and radii of balls for ambient occlusion.
        everything: (P,) int64, indices of all parts.
        casts: int64, indices of the parts that cast shadows, by cell of the sun's grid.
        cast_ends: (SUN_CELLS² + 1,) int64, start of each cell in `casts`; a cell ends where the next one starts.
    """

    shapes: np.ndarray
    tapers: np.ndarray
    world_to_unit: np.ndarray
    half_sizes: np.ndarray
    materials: np.ndarray
    paints: np.ndarray
    gloss: np.ndarray
    bounds: np.ndarray
    dimming: np.ndarray
    everything: np.ndarray
    casts: np.ndarray
    cast_ends: np.ndarray


@part
def into(scene: Scene, index: int, point: Vector, weight: float) -> Vector:
    """Transform a point (weight 1) or a direction (weight 0) into the space of a part's unit shape."""
    matrix = scene.world_to_unit
    x, y, z = point
    return (
        matrix[index, 0, 0] * x + matrix[index, 0, 1] * y + matrix[index, 0, 2] * z + weight * matrix[index, 0, 3],
        matrix[index, 1, 0] * x + matrix[index, 1, 1] * y + matrix[index, 1, 2] * z + weight * matrix[index, 1, 3],
        matrix[index, 2, 0] * x + matrix[index, 2, 1] * y + matrix[index, 2, 2] * z + weight * matrix[index, 2, 3],
    )


@part
def nearest(
    scene: Scene, candidates: np.ndarray, begin: int, end: int, origin: Vector, direction: Vector
) -> tuple[float, int]:
    """Ray parameter t and index of the first part hit among candidates begin…end - 1; infinity and -1 if none."""
    closest, index = math.inf, -1
    for number in range(begin, end):
        candidate = candidates[number]
        start, heading = into(scene, candidate, origin, 1.0), into(scene, candidate, direction, 0.0)
        distance = hit(scene.shapes[candidate], scene.tapers[candidate], start, heading)
        if distance < closest:
            closest, index = distance, candidate
    return closest, index


@part
def sun_cell(point: Vector) -> int:
    """The cell of the sun's grid for a point's shadow ray; rays outside the grid use a corner cell."""
    column = (dot(point, SUN_ACROSS) + SUN_REACH) / SUN_CELL
    row = (dot(point, SUN_UP) + SUN_REACH) / SUN_CELL
    inside = 0 <= column < SUN_CELLS and 0 <= row < SUN_CELLS
    return int(row) * SUN_CELLS + int(column) if inside else 0
