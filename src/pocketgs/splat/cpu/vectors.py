"""Three-component vectors and 3 x 3 matrices as tuples, which kernels keep in registers."""

from __future__ import annotations

import numpy as np

from pocketgs.system.compile import inlined

Vector = tuple[float, float, float]
Matrix = np.ndarray | tuple[Vector, Vector, Vector]


@inlined
def dot(a: Vector, b: Vector) -> float:
    """A · b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inlined
def scaled(a: Vector, factor: float) -> Vector:
    """A scaled by a number."""
    return (a[0] * factor, a[1] * factor, a[2] * factor)


@inlined
def times(matrix: Matrix, vector: Vector) -> Vector:
    """Matrix · vector, for an array or a tuple of rows."""
    return (dot(matrix[0], vector), dot(matrix[1], vector), dot(matrix[2], vector))


@inlined
def transposed_times(matrix: Matrix, vector: Vector) -> Vector:
    """Transposed matrix · vector."""
    x, y, z = vector
    return (
        matrix[0][0] * x + matrix[1][0] * y + matrix[2][0] * z,
        matrix[0][1] * x + matrix[1][1] * y + matrix[2][1] * z,
        matrix[0][2] * x + matrix[1][2] * y + matrix[2][2] * z,
    )


@inlined
def axes_of(quaternion: tuple[float, float, float, float]) -> tuple[Vector, Vector, Vector]:
    """The Gaussian's three axes in the world: the columns of the rotation matrix of a unit quaternion w, x, y, z."""
    w, x, y, z = quaternion
    return (
        (1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)),
        (2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)),
        (2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)),
    )
