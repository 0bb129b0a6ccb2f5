"""Lenses for kernels, one type per camera model.

Numba compiles a kernel for each type of lens, with the formulas of that model only. `pinhole.py`, `perspective.py`,
`fisheye.py` and `orthographic.py` contain those of one model each; `splat/reference/lenses.py` has all of them in
readable NumPy.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from pocketgs.geometry.camera import Camera
from pocketgs.geometry.lens import largest_angle
from pocketgs.splat.slope_limits import slope_limits


class Pinhole(NamedTuple):
    """No lens. The view contains all parameters."""

    kind: int = 0


class Perspective(NamedTuple):
    """OpenCV's distortion of x/z and y/z.

    Its coefficients, the minimum and maximum slopes at which the Jacobian is evaluated, and the square of the largest
    valid slope.
    """

    k1: float
    k2: float
    p1: float
    p2: float
    k3: float
    k4: float
    k5: float
    k6: float
    s1: float
    s2: float
    s3: float
    s4: float
    low_x: float
    high_x: float
    low_y: float
    high_y: float
    largest_square: float


class Fisheye(NamedTuple):
    """Kannala and Brandt's polynomial of the angle off axis, and the cosine of the largest valid angle."""

    k1: float
    k2: float
    k3: float
    k4: float
    least_cosine: float


class Orthographic(NamedTuple):
    """Parallel rays."""

    kind: int = 0
    other: int = 0


KernelLens = Pinhole | Perspective | Fisheye | Orthographic


def kernel_lens(camera: Camera) -> KernelLens:
    """The lens of a camera."""
    lens = camera.lens
    if camera.is_pinhole:
        return Pinhole()
    if lens.model == "orthographic":
        return Orthographic()
    limit = largest_angle(lens)
    if lens.model == "fisheye":
        k1, k2, k3, k4 = map(float, lens.coefficients)
        return Fisheye(k1, k2, k3, k4, math.cos(limit))
    low, high = slope_limits(camera)
    held = (low[0], high[0], low[1], high[1])
    return Perspective._make(map(float, (*lens.padded, *held, math.tan(limit) ** 2)))
