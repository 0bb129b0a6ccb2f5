"""The projection of a pinhole camera: (x, y, z) ↦ (fx x/z + cx, fy y/z + cy)."""

from __future__ import annotations

from pocketgs.splat.constants import FRUSTUM_MARGIN
from pocketgs.splat.cpu.lanes import Floats
from pocketgs.splat.cpu.layout import View
from pocketgs.splat.cpu.lenses.angle import where
from pocketgs.splat.cpu.lenses.jacobians import Jacobian
from pocketgs.splat.cpu.lenses.lens import Pinhole
from pocketgs.splat.cpu.vectors import Vector
from pocketgs.system.compile import inlined


def depth_of(view: View, lens: Pinhole, local: Vector) -> float:
    """The depth that splats are sorted by."""
    return local[2]


def shows(view: View, lens: Pinhole, local: Vector, largest: float) -> bool:
    """Whether a Gaussian beyond the near plane is visible.

    Gaussians beside the image that reach the camera's plane are not: their image is no ellipse, and the linearised
    projection would draw them as a veil.
    """
    low_x, high_x, low_y, high_y = slope_bounds(view)
    x, y = local[0] / local[2], local[1] / local[2]
    is_beside = x < low_x or x > high_x or y < low_y or y > high_y
    return not (is_beside and largest > local[2])


def centre_of(view: View, lens: Pinhole, local: Vector) -> tuple[float, float]:
    """Pixel coordinates of a camera-space position."""
    return view.fx * local[0] / local[2] + view.cx, view.fy * local[1] / local[2] + view.cy


@inlined
def slope_bounds(view: View) -> tuple[float, float, float, float]:
    """Minimum and maximum x/z, then y/z, in the image and a margin around it."""
    margin_x, margin_y = FRUSTUM_MARGIN * view.width, FRUSTUM_MARGIN * view.height
    return (
        -(view.cx + margin_x) / view.fx,
        (view.width - view.cx + margin_x) / view.fx,
        -(view.cy + margin_y) / view.fy,
        (view.height - view.cy + margin_y) / view.fy,
    )


@inlined
def clamped_slopes(view: View, local: Vector) -> tuple[float, float]:
    """x/z and y/z clamped to `slope_bounds`, beyond which the linearised projection explodes."""
    low_x, high_x, low_y, high_y = slope_bounds(view)
    return min(max(local[0] / local[2], low_x), high_x), min(max(local[1] / local[2], low_y), high_y)


def jacobian_at(view: View, lens: Pinhole, local: Vector) -> Jacobian:
    """The projection's derivative at a camera-space position."""
    slope_x, slope_y = clamped_slopes(view, local)
    return (view.fx / local[2], -view.fx * slope_x / local[2], view.fy / local[2], -view.fy * slope_y / local[2])


def position_backward(
    view: View, lens: Pinhole, local: Vector, jacobian: Jacobian, d_mean: tuple[Floats, Floats], d_jacobian: Jacobian
) -> Vector:
    """Gradient with respect to the camera-space position, from the projected centre and from the Jacobian."""
    x, y, z = local
    slope_x, slope_y = clamped_slopes(view, local)
    d_x = d_mean[0] * view.fx / z
    d_y = d_mean[1] * view.fy / z
    d_z = (d_x * x + d_y * y) / z
    xx, xz, yy, yz = jacobian
    # xx = fx/z and xz = -fx x/z², or -fx · limit/z where clamped.
    d_z = d_z + (xx * d_jacobian[0] + yy * d_jacobian[2]) / z
    through_x, through_y = d_jacobian[1] / z, d_jacobian[3] / z
    moving_x, moving_y = slope_x == x / z, slope_y == y / z
    d_x = d_x - where(moving_x, xx * through_x, 0.0)
    d_y = d_y - where(moving_y, yy * through_y, 0.0)
    d_z = d_z + xz * through_x + where(moving_x, xz * through_x, 0.0)
    d_z = d_z + yz * through_y + where(moving_y, yz * through_y, 0.0)
    return (d_x, d_y, d_z * -1.0)
