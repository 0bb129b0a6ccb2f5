"""OpenCV's lens: (x, y, z) ↦ f d(x/z, y/z) + c with d radial, tangential and thin-prism distortion.

With q = x² + y² and the radial factor R(q), d = (x R + 2 p1 x y + p2 (q + 2 x²) + s1 q + s2 q²,
y R + p1 (q + 2 y²) + 2 p2 x y + s3 q + s4 q²).
"""

from __future__ import annotations

import numpy as np

from pocketgs.splat.cpu.lanes import Floats, broadcast, select
from pocketgs.splat.cpu.layout import View
from pocketgs.splat.cpu.lenses.jacobians import Jacobian
from pocketgs.splat.cpu.lenses.lens import Perspective
from pocketgs.splat.cpu.vectors import Vector
from pocketgs.system.compile import inlined


def depth_of(view: View, lens: Perspective, local: Vector) -> float:
    """The depth that splats are sorted by."""
    return local[2]


def shows(view: View, lens: Perspective, local: Vector, largest: float) -> bool:
    """Whether a Gaussian beyond the near plane is visible: as `pinhole.shows`, and within the lens's valid angle."""
    across = local[0] * local[0] + local[1] * local[1]
    x, y = local[0] / local[2], local[1] / local[2]
    is_beside = x < lens.low_x or x > lens.high_x or y < lens.low_y or y > lens.high_y
    return across <= lens.largest_square * local[2] * local[2] and not (is_beside and largest > local[2])


@inlined
def _radial(lens: Perspective, q: float) -> tuple[float, float, float]:
    """R(q) and its first two derivatives."""
    upper = 1.0 + q * (lens.k1 + q * (lens.k2 + q * lens.k3))
    upper1 = lens.k1 + q * (2.0 * lens.k2 + q * (3.0 * lens.k3))
    upper2 = 2.0 * lens.k2 + q * (6.0 * lens.k3)
    lower = 1.0 + q * (lens.k4 + q * (lens.k5 + q * lens.k6))
    lower1 = lens.k4 + q * (2.0 * lens.k5 + q * (3.0 * lens.k6))
    lower2 = 2.0 * lens.k5 + q * (6.0 * lens.k6)
    value = upper / lower
    first = (upper1 - value * lower1) / lower
    return value, first, (upper2 - 2.0 * first * lower1 - value * lower2) / lower


def centre_of(view: View, lens: Perspective, local: Vector) -> tuple[float, float]:
    """Pixel coordinates of a camera-space position."""
    x, y = local[0] / local[2], local[1] / local[2]
    q = x * x + y * y
    radial, _, _ = _radial(lens, q)
    shown_x = x * radial + 2.0 * lens.p1 * x * y + lens.p2 * (q + 2.0 * x * x) + q * (lens.s1 + q * lens.s2)
    shown_y = y * radial + lens.p1 * (q + 2.0 * y * y) + 2.0 * lens.p2 * x * y + q * (lens.s3 + q * lens.s4)
    return view.fx * shown_x + view.cx, view.fy * shown_y + view.cy


@inlined
def _held_slopes(lens: Perspective, local: Vector) -> tuple[float, float]:
    """x/z and y/z clamped to the image and a margin around it."""
    x = min(max(local[0] / local[2], lens.low_x), lens.high_x)
    y = min(max(local[1] / local[2], lens.low_y), lens.high_y)
    return x, y


@inlined
def _slopes_jacobian(lens: Perspective, x: float, y: float) -> tuple[float, float, float, float]:
    """∂d/∂(x, y): xx, xy, yx, yy."""
    q = x * x + y * y
    radial, first, _ = _radial(lens, q)
    along_x, along_y = x * first + lens.s1 + 2.0 * lens.s2 * q, y * first + lens.s3 + 2.0 * lens.s4 * q
    mixed = 2.0 * (lens.p1 * x + lens.p2 * y)
    return (
        radial + 2.0 * x * along_x + 2.0 * (lens.p1 * y + 3.0 * lens.p2 * x),
        2.0 * y * along_x + mixed,
        2.0 * x * along_y + mixed,
        radial + 2.0 * y * along_y + 2.0 * (3.0 * lens.p1 * y + lens.p2 * x),
    )


def jacobian_at(view: View, lens: Perspective, local: Vector) -> Jacobian:
    """The projection's derivative at a camera-space position."""
    x, y = _held_slopes(lens, local)
    xx, xy, yx, yy = _slopes_jacobian(lens, x, y)
    across, down = view.fx / local[2], view.fy / local[2]
    towards_x, towards_y = (xx * x + xy * y) * -1.0, (yx * x + yy * y) * -1.0
    return (across * xx, across * xy, across * towards_x, down * yx, down * yy, down * towards_y)


def position_backward(
    view: View,
    lens: Perspective,
    local: Vector,
    jacobian: Jacobian,
    d_mean: tuple[Floats, Floats],
    d_jacobian: Jacobian,
) -> Vector:
    """Gradient with respect to the camera-space position, from the projected centre and from the Jacobian."""
    z = local[2]
    slope_x, slope_y = local[0] / z, local[1] / z
    xx, xy, yx, yy = _slopes_jacobian(lens, slope_x, slope_y)
    d_u, d_v = d_mean[0] * view.fx, d_mean[1] * view.fy
    d_slope_x, d_slope_y = xx * d_u + yx * d_v, xy * d_u + yy * d_v
    x, y = _held_slopes(lens, local)
    # Columns x and y are f D/z, and column z is -(column x · slope x + column y · slope y), with D = ∂d/∂(x/z, y/z).
    j_xx, j_xy, _, j_yx, j_yy, _ = jacobian
    d_xx, d_xy, d_xz, d_yx, d_yy, d_yz = d_jacobian
    e_xx, e_xy, e_yx, e_yy = d_xx - x * d_xz, d_xy - y * d_xz, d_yx - x * d_yz, d_yy - y * d_yz
    d_z = e_xx * j_xx + e_xy * j_xy + e_yx * j_yx + e_yy * j_yy
    across, down = view.fx / z, view.fy / z
    through_x, through_y = _second_derivatives(lens, x, y, e_xx * across, e_xy * across, e_yx * down, e_yy * down)
    zero = broadcast(np.float32(0.0))
    through_x = through_x - j_xx * d_xz - j_yx * d_yz
    through_y = through_y - j_xy * d_xz - j_yy * d_yz
    d_slope_x = d_slope_x + select(x == slope_x, through_x, zero)
    d_slope_y = d_slope_y + select(y == slope_y, through_y, zero)
    d_z = d_z + d_slope_x * slope_x + d_slope_y * slope_y
    return (d_slope_x / z, d_slope_y / z, d_z / z * -1.0)


@inlined
def _second_derivatives(
    lens: Perspective, x: float, y: float, d_xx: float, d_xy: float, d_yx: float, d_yy: float
) -> tuple[float, float]:
    """Gradient with respect to (x, y) from that with respect to `_slopes_jacobian`."""
    q = x * x + y * y
    _, first, second = _radial(lens, q)
    # Terms that both components of d have in common: of x² and y², and of x y.
    bend_x, bend_y = x * second + 2.0 * lens.s2, y * second + 2.0 * lens.s4
    even_x = 2.0 * (x * first + lens.s1 + 2.0 * lens.s2 * q)
    even_y = 2.0 * (y * first + lens.s3 + 2.0 * lens.s4 * q)
    x_xx = 4.0 * x * first + 4.0 * x * x * bend_x + even_x + 6.0 * lens.p2
    x_xy = 2.0 * y * first + 4.0 * x * y * bend_x + 2.0 * lens.p1
    x_yy = 4.0 * y * y * bend_x + even_x + 2.0 * lens.p2
    y_xx = 4.0 * x * x * bend_y + even_y + 2.0 * lens.p1
    y_xy = 2.0 * x * first + 4.0 * x * y * bend_y + 2.0 * lens.p2
    y_yy = 4.0 * y * first + 4.0 * y * y * bend_y + even_y + 6.0 * lens.p1
    return (
        d_xx * x_xx + d_xy * x_xy + d_yx * y_xx + d_yy * y_xy,
        d_xx * x_xy + d_xy * x_yy + d_yx * y_xy + d_yy * y_yy,
    )
