"""The orthographic projection: (x, y, z) ↦ (fx x + cx, fy y + cy), with focal lengths in pixels per unit."""

from __future__ import annotations

from pocketgs.splat.cpu.lanes import Floats
from pocketgs.splat.cpu.layout import View
from pocketgs.splat.cpu.lenses.jacobians import Jacobian
from pocketgs.splat.cpu.lenses.lens import Orthographic
from pocketgs.splat.cpu.vectors import Vector


def depth_of(view: View, lens: Orthographic, local: Vector) -> float:
    """The depth that splats are sorted by."""
    return local[2]


def shows(view: View, lens: Orthographic, local: Vector, largest: float) -> bool:
    """Whether a Gaussian beyond the near plane is visible."""
    return local[2] > 0.0


def centre_of(view: View, lens: Orthographic, local: Vector) -> tuple[float, float]:
    """Pixel coordinates of a camera-space position."""
    return view.fx * local[0] + view.cx, view.fy * local[1] + view.cy


def jacobian_at(view: View, lens: Orthographic, local: Vector) -> Jacobian:
    """The projection's derivative, which is constant."""
    return (view.fx, 0.0, view.fy, 0.0)


def position_backward(
    view: View,
    lens: Orthographic,
    local: Vector,
    jacobian: Jacobian,
    d_mean: tuple[Floats, Floats],
    d_jacobian: Jacobian,
) -> Vector:
    """Gradient with respect to the camera-space position, from the projected centre alone."""
    return (d_mean[0] * view.fx, d_mean[1] * view.fy, 0.0)
