"""The projection's derivative, 2 x 3, as a tuple of the entries that may be non-zero, and products with it.

A pinhole camera has four entries: xx, xz, yy, yz. Others have six: xx, xy, xz, yx, yy, yz.
"""

from __future__ import annotations

from typing import Any

from numba.extending import overload

from pocketgs.splat.cpu.lanes import Floats
from pocketgs.splat.cpu.vectors import Vector
from pocketgs.system.compile import INLINED

Jacobian = tuple[float, ...]
Pair = tuple[Floats, Floats]


def along(jacobian: Jacobian, a: Vector) -> Pair:
    """J a, in kernels only."""
    raise NotImplementedError("for kernels only")


def back_along(jacobian: Jacobian, du: Pair) -> Vector:
    """Jᵀ du, in kernels only."""
    raise NotImplementedError("for kernels only")


def no_gradient(jacobian: Jacobian) -> Jacobian:
    """A gradient of zeros with respect to J, in kernels only."""
    raise NotImplementedError("for kernels only")


def with_product(gradient: Jacobian, du: Pair, a: Vector) -> Jacobian:
    """The gradient with respect to J plus du aᵀ, in kernels only."""
    raise NotImplementedError("for kernels only")


@overload(along, jit_options=INLINED)
def _along(jacobian: Jacobian, a: Vector) -> Any:
    if len(jacobian) == 4:
        return _along_4
    return _along_6


def _along_4(jacobian: Jacobian, a: Vector) -> Pair:
    xx, xz, yy, yz = jacobian
    return (xx * a[0] + xz * a[2], yy * a[1] + yz * a[2])


def _along_6(jacobian: Jacobian, a: Vector) -> Pair:
    xx, xy, xz, yx, yy, yz = jacobian
    return (xx * a[0] + xy * a[1] + xz * a[2], yx * a[0] + yy * a[1] + yz * a[2])


@overload(back_along, jit_options=INLINED)
def _back_along(jacobian: Jacobian, du: Pair) -> Any:
    if len(jacobian) == 4:
        return _back_along_4
    return _back_along_6


def _back_along_4(jacobian: Jacobian, du: Pair) -> Vector:
    return (jacobian[0] * du[0], jacobian[2] * du[1], jacobian[1] * du[0] + jacobian[3] * du[1])


def _back_along_6(jacobian: Jacobian, du: Pair) -> Vector:
    xx, xy, xz, yx, yy, yz = jacobian
    return (xx * du[0] + yx * du[1], xy * du[0] + yy * du[1], xz * du[0] + yz * du[1])


@overload(no_gradient, jit_options=INLINED)
def _no_gradient(jacobian: Jacobian) -> Any:
    if len(jacobian) == 4:
        return _no_gradient_4
    return _no_gradient_6


def _no_gradient_4(jacobian: Jacobian) -> Jacobian:
    return (0.0, 0.0, 0.0, 0.0)


def _no_gradient_6(jacobian: Jacobian) -> Jacobian:
    return (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@overload(with_product, jit_options=INLINED)
def _with_product(gradient: Jacobian, du: Pair, a: Vector) -> Any:
    if len(gradient) == 4:
        return _with_product_4
    return _with_product_6


def _with_product_4(gradient: Jacobian, du: Pair, a: Vector) -> Jacobian:
    xx, xz, yy, yz = gradient
    return (xx + du[0] * a[0], xz + du[0] * a[2], yy + du[1] * a[1], yz + du[1] * a[2])


def _with_product_6(gradient: Jacobian, du: Pair, a: Vector) -> Jacobian:
    xx, xy, xz, yx, yy, yz = gradient
    return (
        xx + du[0] * a[0],
        xy + du[0] * a[1],
        xz + du[0] * a[2],
        yx + du[1] * a[0],
        yy + du[1] * a[1],
        yz + du[1] * a[2],
    )
