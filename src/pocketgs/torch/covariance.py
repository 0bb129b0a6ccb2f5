"""Covariances from scales and rotations, in the world, in the camera's axes and on the image, in plain PyTorch.

These are gsplat's building blocks of the same names. `Project2D` computes all three in one pass; the tests compare it
with them, and double precision uses them.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

import torch
from torch import Tensor
from torch.nn.functional import normalize

from pocketgs.splat.constants import FRUSTUM_MARGIN
from pocketgs.torch.arrays import check_shape, check_tensors
from pocketgs.torch.unsupported import check_camera_model

_TINY = 1e-7

_Parameters = ParamSpec("_Parameters")
_Result = TypeVar("_Result")


def in_full_precision(function: Callable[_Parameters, _Result]) -> Callable[_Parameters, _Result]:
    """The function without autocast, which would round its matrix products to half precision."""

    @wraps(function)
    def exact(*arguments: _Parameters.args, **named: _Parameters.kwargs) -> _Result:
        with torch.autocast("cpu", enabled=False):
            return function(*arguments, **named)

    return exact


def rotations_of(quats: Tensor) -> Tensor:
    """(..., 3, 3) rotations of (..., 4) quaternions w, x, y, z of any length."""
    w, x, y, z = normalize(quats, dim=-1).unbind(-1)
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    return torch.stack([torch.stack(row, -1) for row in rows], -2)


@in_full_precision
def quat_scale_to_covar_preci(
    quats: Tensor, scales: Tensor, compute_covar: bool = True, compute_preci: bool = True, triu: bool = False
) -> tuple[Tensor | None, Tensor | None]:
    """Covariances R S² Rᵀ and their inverses.

    Args:
        quats: (..., 4) w, x, y, z of any length.
        scales: (..., 3) standard deviations.
        compute_covar: whether to compute covariances.
        compute_preci: whether to compute their inverses.
        triu: whether to return the upper triangle (xx, xy, xz, yy, yz, zz) instead of the matrix.

    Returns:
        Both (..., 3, 3), or (..., 6); None if not requested.

    Raises:
        PocketGSError: shapes disagree.
    """
    check_tensors(1, quats=quats, scales=scales)
    check_shape("quats", quats, (*quats.shape[:-1], 4))
    check_shape("scales", scales, (*quats.shape[:-1], 3))
    axes = rotations_of(quats)

    def product(sizes: Tensor) -> Tensor:
        sized = axes * sizes[..., None, :]
        matrix = sized @ sized.transpose(-1, -2)
        return upper_triangle(matrix) if triu else matrix

    return product(scales) if compute_covar else None, product(1.0 / scales) if compute_preci else None


def upper_triangle(matrices: Tensor) -> Tensor:
    """(..., 6) xx, xy, xz, yy, yz, zz of symmetric (..., 3, 3) matrices; both halves share their gradients."""
    both = 0.5 * (matrices + matrices.transpose(-1, -2))
    rows, columns = torch.triu_indices(3, 3)
    return both[..., rows, columns]


def from_upper_triangle(triangles: Tensor) -> Tensor:
    """(..., 3, 3) symmetric matrices from the output of `upper_triangle`."""
    places = torch.tensor([[0, 1, 2], [1, 3, 4], [2, 4, 5]])
    return triangles[..., places]


@in_full_precision
def world_to_cam(means: Tensor, covars: Tensor, viewmats: Tensor) -> tuple[Tensor, Tensor]:
    """Transform Gaussians into cameras' axes.

    Args:
        means: (..., N, 3).
        covars: (..., N, 3, 3).
        viewmats: (..., C, 4, 4) world_to_camera.

    Returns:
        Means (..., C, N, 3) and covariances (..., C, N, 3, 3).

    Raises:
        PocketGSError: shapes disagree.
    """
    check_tensors(2, means=means)
    check_tensors(3, covars=covars, viewmats=viewmats)
    *lead, count = means.shape[:-1]
    check_shape("means", means, (*lead, count, 3))
    check_shape("covars", covars, (*lead, count, 3, 3))
    check_shape("viewmats", viewmats, (*lead, -1, 4, 4))
    rotations, shifts = viewmats[..., None, :3, :3], viewmats[..., None, :3, 3]
    local = (rotations @ means[..., None, :, :, None])[..., 0] + shifts
    return local, rotations @ covars[..., None, :, :, :] @ rotations.transpose(-1, -2)


@in_full_precision
def proj(
    means: Tensor, covars: Tensor, Ks: Tensor, width: int, height: int, camera_model: str = "pinhole"
) -> tuple[Tensor, Tensor]:
    """Project Gaussians in cameras' axes to the image: centres, and covariances by the Jacobian.

    Args:
        means: (..., C, N, 3).
        covars: (..., C, N, 3, 3).
        Ks: (..., C, 3, 3) intrinsics in pixels.
        width: of the image.
        height: of the image.
        camera_model: "pinhole"; "ortho", which does not divide by the depth; or "fisheye", equidistant.

    Returns:
        Means (..., C, N, 2) in pixels and covariances (..., C, N, 2, 2).

    Raises:
        PocketGSError: shapes disagree, or the camera model is none of these.
    """
    check_camera_model(camera_model)
    check_tensors(2, means=means, covars=covars, Ks=Ks)
    lead, count = tuple(means.shape[:-2]), means.shape[-2]
    check_shape("means", means, (*lead, count, 3))
    check_shape("covars", covars, (*lead, count, 3, 3))
    check_shape("Ks", Ks, (*lead, 3, 3))
    focal, centre = Ks[..., None, (0, 1), (0, 1)], Ks[..., None, :2, 2]
    if camera_model == "pinhole":
        size = torch.tensor([width, height], dtype=means.dtype)
        places, jacobians = _pinhole(means, focal, centre, size)
    elif camera_model == "ortho":
        places = means[..., :2] * focal + centre
        jacobians = _rows(focal[..., 0], 0.0, 0.0, 0.0, focal[..., 1], 0.0, means)
    else:
        places, jacobians = _fisheye(means, focal, centre)
    return places, jacobians @ covars @ jacobians.transpose(-1, -2)


def _rows(
    xx: Tensor | float,
    xy: Tensor | float,
    xz: Tensor | float,
    yx: Tensor | float,
    yy: Tensor | float,
    yz: Tensor | float,
    means: Tensor,
) -> Tensor:
    """(..., 2, 3) Jacobians from their entries."""
    zero = torch.zeros_like(means[..., 0])
    return torch.stack([zero + entry for entry in (xx, xy, xz, yx, yy, yz)], -1).unflatten(-1, (2, 3))


def _pinhole(means: Tensor, focal: Tensor, centre: Tensor, size: Tensor) -> tuple[Tensor, Tensor]:
    """Slopes beyond the image and a margin are clamped in the Jacobian, which would explode there."""
    depth = means[..., 2:]
    slopes = means[..., :2] / depth
    low, high = -(centre + FRUSTUM_MARGIN * size) / focal, (size - centre + FRUSTUM_MARGIN * size) / focal
    diagonal = focal / depth
    across = -diagonal * torch.minimum(torch.maximum(slopes, low), high)
    jacobians = _rows(diagonal[..., 0], 0.0, across[..., 0], 0.0, diagonal[..., 1], across[..., 1], means)
    return slopes * focal + centre, jacobians


def _fisheye(means: Tensor, focal: Tensor, centre: Tensor) -> tuple[Tensor, Tensor]:
    """Equidistant: u = f θ x/r + c with θ the angle from the axis and r² = x² + y² (Kannala and Brandt 2006)."""
    x, y, z = means.unbind(-1)
    # On the axis, 0/0 must give the limit, 1/z.
    xx, yy = x * x + _TINY * _TINY, y * y
    square = xx + yy
    r = square.sqrt()
    angle, whole = torch.atan2(r, z), square + z * z
    along, across = z / (square * whole), angle / (square * r)
    fx, fy = focal.unbind(-1)
    jacobians = _rows(
        fx * (xx * along + yy * across),
        fx * x * y * (along - across),
        -fx * x / whole,
        fy * x * y * (along - across),
        fy * (yy * along + xx * across),
        -fy * y / whole,
        means,
    )
    return means[..., :2] * (angle / r)[..., None] * focal + centre, jacobians
