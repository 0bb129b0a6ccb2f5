"""Dispatch of a lens's formulas: Numba chooses them when it compiles a kernel."""

from __future__ import annotations

from types import ModuleType
from typing import Any

from numba.extending import overload

from pocketgs.splat.cpu.lanes import Floats
from pocketgs.splat.cpu.layout import View
from pocketgs.splat.cpu.lenses import fisheye, orthographic, perspective, pinhole
from pocketgs.splat.cpu.lenses.jacobians import Jacobian
from pocketgs.splat.cpu.lenses.lens import Fisheye, KernelLens, Orthographic, Perspective, Pinhole
from pocketgs.splat.cpu.vectors import Vector
from pocketgs.system.compile import INLINED

_FORMULAS = {Pinhole: pinhole, Perspective: perspective, Fisheye: fisheye, Orthographic: orthographic}


def _formulas(lens: Any) -> ModuleType:
    """The module of a lens, from its Numba type."""
    return _FORMULAS[lens.instance_class]


def depth_of(view: View, lens: KernelLens, local: Vector) -> float:
    """The depth that splats are sorted by, in kernels only; see `pocketgs.geometry.lens.depths`."""
    raise NotImplementedError("for kernels only")


def shows(view: View, lens: KernelLens, local: Vector, largest: float) -> bool:
    """Whether a Gaussian beyond the near plane is visible, given its largest standard deviation; in kernels only."""
    raise NotImplementedError("for kernels only")


def centre_of(view: View, lens: KernelLens, local: Vector) -> tuple[float, float]:
    """Pixel coordinates of a camera-space position, in kernels only."""
    raise NotImplementedError("for kernels only")


def jacobian_at(view: View, lens: KernelLens, local: Vector) -> Jacobian:
    """The projection's derivative at a camera-space position of numbers or vectors, in kernels only."""
    raise NotImplementedError("for kernels only")


def position_backward(
    view: View, lens: KernelLens, local: Vector, jacobian: Jacobian, d_mean: tuple[Floats, Floats], d_jacobian: Jacobian
) -> Vector:
    """Gradient with respect to the camera-space position, from those with respect to the projected centre and J."""
    raise NotImplementedError("for kernels only")


@overload(depth_of, strict=False, jit_options=INLINED)
def _depth_of(view: View, lens: KernelLens, local: Vector) -> Any:
    return _formulas(lens).depth_of


@overload(shows, strict=False, jit_options=INLINED)
def _shows(view: View, lens: KernelLens, local: Vector, largest: float) -> Any:
    return _formulas(lens).shows


@overload(centre_of, strict=False, jit_options=INLINED)
def _centre_of(view: View, lens: KernelLens, local: Vector) -> Any:
    return _formulas(lens).centre_of


@overload(jacobian_at, strict=False, jit_options=INLINED)
def _jacobian_at(view: View, lens: KernelLens, local: Vector) -> Any:
    return _formulas(lens).jacobian_at


@overload(position_backward, strict=False, jit_options=INLINED)
def _position_backward(
    view: View, lens: KernelLens, local: Vector, jacobian: Jacobian, d_mean: tuple[Floats, Floats], d_jacobian: Jacobian
) -> Any:
    return _formulas(lens).position_backward
