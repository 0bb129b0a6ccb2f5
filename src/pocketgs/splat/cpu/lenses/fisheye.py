"""The fisheye projection: (x, y, z) ↦ f s (x, y) + c with s = θ_d/r, r² = x² + y² and θ = atan2(r, z).

θ_d = θ P(θ²) with P(w) = 1 + k1 w + k2 w² + k3 w³ + k4 w⁴ (Kannala and Brandt 2006). s depends on x and y only through
r: ∂s/∂x = A x and ∂s/∂z = B; the derivatives of A are C x and E, those of B are E x and F.
"""

from __future__ import annotations

from pocketgs.splat.cpu.lanes import Floats
from pocketgs.splat.cpu.layout import View
from pocketgs.splat.cpu.lenses.angle import angle, root, where
from pocketgs.splat.cpu.lenses.jacobians import Jacobian
from pocketgs.splat.cpu.lenses.lens import Fisheye
from pocketgs.splat.cpu.vectors import Vector, dot
from pocketgs.system.compile import inlined

_NEAR_AXIS = 0.01
"""Quotients by r use a power series if (r/z)² is less than this."""

Derivatives = tuple[float, float, float, float, float, float]
"""s, A, B, C, E, F."""


def depth_of(view: View, lens: Fisheye, local: Vector) -> float:
    """The depth that splats are sorted by: the distance, since z does not order points at or behind the image plane."""
    return root(dot(local, local))


def shows(view: View, lens: Fisheye, local: Vector, largest: float) -> bool:
    """Whether a Gaussian beyond the near plane is visible: it is within the lens's valid angle."""
    return local[2] >= lens.least_cosine * root(dot(local, local))


@inlined
def _equidistant(q: float, z: float) -> tuple[float, float, float]:
    """θ/r and, for a lens without coefficients, A and C, from q = r²."""
    r, square = root(q), q + z * z
    s = angle(r, z) / r
    a = (z / square - s) / q
    c = (-2.0 * z / (square * square) - 3.0 * a) / q
    t = q / (z * z)
    near_s = (1.0 - t * (1.0 / 3.0 - t * (1.0 / 5.0 - t * (1.0 / 7.0 - t * (1.0 / 9.0 - t / 11.0))))) / z
    near_a = (-2.0 / 3.0 + t * (4.0 / 5.0 - t * (6.0 / 7.0 - t * (8.0 / 9.0 - t * (10.0 / 11.0))))) / (z * z * z)
    near_c = (8.0 / 5.0 - t * (24.0 / 7.0 - t * (16.0 / 3.0 - t * (80.0 / 11.0)))) / (z * z * z * z * z)
    near = (z >= 0.0) & (t < _NEAR_AXIS)
    return where(near, near_s, s), where(near, near_a, a), where(near, near_c, c)


@inlined
def _derivatives(lens: Fisheye, local: Vector) -> Derivatives:
    """S and its derivatives; the compiler removes unused ones."""
    x, y, z = local
    q = x * x + y * y
    square = q + z * z
    along = z / square
    s0, a0, c0 = _equidistant(q, z)
    w = s0 * s0 * q
    p = 1.0 + w * (lens.k1 + w * (lens.k2 + w * (lens.k3 + w * lens.k4)))
    p1 = lens.k1 + w * (2.0 * lens.k2 + w * (3.0 * lens.k3 + w * (4.0 * lens.k4)))
    p2 = 2.0 * lens.k2 + w * (6.0 * lens.k3 + w * (12.0 * lens.k4))
    slope, bend = p + 2.0 * w * p1, s0 * (6.0 * p1 + 4.0 * w * p2)  # θ_d' and θ_d''/r
    turn = s0 * along
    a = a0 * p + 2.0 * s0 * turn * p1
    c = c0 * p + turn * (6.0 * a0 - 4.0 * s0 / square) * p1 + 4.0 * s0 * turn * turn * p2
    b = slope / square * -1.0
    e = (2.0 * slope - z * bend) / (square * square)
    f = (2.0 * slope * z + bend * q) / (square * square)
    return s0 * p, a, b, c, e, f


def centre_of(view: View, lens: Fisheye, local: Vector) -> tuple[float, float]:
    """Pixel coordinates of a camera-space position."""
    s, _, _, _, _, _ = _derivatives(lens, local)
    return view.fx * s * local[0] + view.cx, view.fy * s * local[1] + view.cy


def jacobian_at(view: View, lens: Fisheye, local: Vector) -> Jacobian:
    """The projection's derivative at a camera-space position."""
    x, y, _ = local
    s, a, b, _, _, _ = _derivatives(lens, local)
    fx, fy = view.fx, view.fy
    return (
        (s + a * x * x) * fx,
        a * x * y * fx,
        b * x * fx,
        a * x * y * fy,
        (s + a * y * y) * fy,
        b * y * fy,
    )


def position_backward(
    view: View, lens: Fisheye, local: Vector, jacobian: Jacobian, d_mean: tuple[Floats, Floats], d_jacobian: Jacobian
) -> Vector:
    """Gradient with respect to the camera-space position, from the projected centre and from the Jacobian."""
    x, y, _ = local
    _, a, b, c, e, f = _derivatives(lens, local)
    xx, xy, xz, yx, yy, yz = jacobian
    d_x, d_y, d_z = (
        xx * d_mean[0] + yx * d_mean[1],
        xy * d_mean[0] + yy * d_mean[1],
        xz * d_mean[0] + yz * d_mean[1],
    )
    d_xx, d_xy, d_xz = d_jacobian[0] * view.fx, d_jacobian[1] * view.fx, d_jacobian[2] * view.fx
    d_yx, d_yy, d_yz = d_jacobian[3] * view.fy, d_jacobian[4] * view.fy, d_jacobian[5] * view.fy
    d_s, d_b = d_xx + d_yy, d_xz * x + d_yz * y
    mixed = d_xy + d_yx
    d_a = (d_xx * x + mixed * y) * x + d_yy * y * y
    through = d_s * a + d_a * c + d_b * e
    d_x = d_x + through * x + a * (2.0 * d_xx * x + mixed * y) + b * d_xz
    d_y = d_y + through * y + a * (2.0 * d_yy * y + mixed * x) + b * d_yz
    return (d_x, d_y, d_z + d_s * b + d_a * e + d_b * f)
