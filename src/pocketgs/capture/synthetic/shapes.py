"""Ray intersection with boxes, balls and frustums, each a unit shape under an affine map.

Rays and points are in the unit shape's own space, where the ray parameter t is the same as in the world: the box is
[-1, 1]³, the ball has radius 1, and the frustum stands along z from -1, with radius 1, to 1, with radius `taper` (1
makes it a cylinder, 0 a cone).
"""

from __future__ import annotations

import math

from pocketgs.system.compile import part

Vector = tuple[float, float, float]

BOX, BALL, FRUSTUM = range(3)


@part
def dot(a: Vector, b: Vector) -> float:
    """A · b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@part
def unit_vector(vector: Vector) -> Vector:
    """A vector of length 1 in the same direction."""
    factor = 1 / math.sqrt(dot(vector, vector))
    return (vector[0] * factor, vector[1] * factor, vector[2] * factor)


@part
def along(origin: Vector, direction: Vector, distance: float) -> Vector:
    """The point at `distance` on a ray."""
    return (
        origin[0] + distance * direction[0],
        origin[1] + distance * direction[1],
        origin[2] + distance * direction[2],
    )


@part
def hit(shape: int, taper: float, origin: Vector, direction: Vector) -> float:
    """The smallest t > 0 at which origin + t·direction enters the unit shape; infinity if it misses."""
    if shape == BOX:
        return _hit_box(origin, direction)
    if shape == BALL:
        return _hit_ball(origin, direction)
    return _hit_frustum(taper, origin, direction)


@part
def normal_and_place(shape: int, taper: float, point: Vector) -> tuple[Vector, float, float]:
    """The outward normal (of any length) at a point of the unit shape, and the point's texture coordinates (u, v).

    On a box, u and v are the two coordinates along the face. Elsewhere u is the angle about z and v is z, except on a
    frustum's ends, where they are x and y.
    """
    x, y, z = point
    if shape == BOX:
        if abs(x) > abs(y) and abs(x) > abs(z):
            return (math.copysign(1.0, x), 0.0, 0.0), y, z
        if abs(y) > abs(z):
            return (0.0, math.copysign(1.0, y), 0.0), x, z
        return (0.0, 0.0, math.copysign(1.0, z)), x, y
    if shape == FRUSTUM and abs(z) > 1 - 1e-9:
        return (0.0, 0.0, z), x, y
    if shape == FRUSTUM:
        slope = 0.5 * (taper - 1)
        return (x, y, -slope * math.hypot(x, y)), math.atan2(y, x), z
    return point, math.atan2(y, x), z


@part
def _hit_box(origin: Vector, direction: Vector) -> float:
    """Intersection of three slabs (Kay and Kajiya, 1986)."""
    # First to the middle of each slab, then to its faces. Loops over tuples would go through memory.
    x, y, z = 1 / direction[0], 1 / direction[1], 1 / direction[2]
    enters = max(-origin[0] * x - abs(x), -origin[1] * y - abs(y), -origin[2] * z - abs(z))
    leaves = min(-origin[0] * x + abs(x), -origin[1] * y + abs(y), -origin[2] * z + abs(z))
    return enters if 0 < enters < leaves else math.inf


@part
def _hit_ball(origin: Vector, direction: Vector) -> float:
    square, halfway = dot(direction, direction), dot(origin, direction)
    discriminant = halfway * halfway - square * (dot(origin, origin) - 1)
    if discriminant <= 0:
        return math.inf
    distance = (-halfway - math.sqrt(discriminant)) / square
    return distance if distance > 0 else math.inf


@part
def _hit_frustum(taper: float, origin: Vector, direction: Vector) -> float:
    """The nearest intersection with the side, x² + y² = (middle + slope·z)², or with the end that faces the ray."""
    middle, slope = 0.5 * (1 + taper), 0.5 * (taper - 1)
    radius, widening = middle + slope * origin[2], slope * direction[2]
    square = direction[0] * direction[0] + direction[1] * direction[1] - widening * widening
    halfway = origin[0] * direction[0] + origin[1] * direction[1] - radius * widening
    discriminant = halfway * halfway - square * (origin[0] * origin[0] + origin[1] * origin[1] - radius * radius)
    if discriminant <= 0:
        return math.inf
    root = math.sqrt(discriminant)
    first, second = (-halfway - root) / square, (-halfway + root) / square
    end = -math.copysign(1.0, direction[2])
    onto_end = (end - origin[2]) / direction[2]
    x, y, reach = origin[0] + onto_end * direction[0], origin[1] + onto_end * direction[1], middle + slope * end
    nearest = onto_end if onto_end > 0 and x * x + y * y <= reach * reach else math.inf
    if 0 < first < nearest and abs(origin[2] + first * direction[2]) <= 1:
        nearest = first
    if 0 < second < nearest and abs(origin[2] + second * direction[2]) <= 1:
        nearest = second
    return nearest
