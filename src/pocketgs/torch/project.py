"""Projection of Gaussians to splats on the image, in one pass per camera."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from pocketgs.splat.cpu.layout import View
from pocketgs.splat.cpu.lenses.lens import Fisheye, KernelLens, Orthographic, Pinhole
from pocketgs.splat.cpu.operators.projection import MATRIX, project_ewa, project_ewa_backward
from pocketgs.system.dealing import PIECE
from pocketgs.torch.arrays import (
    array_of,
    check_shape,
    check_tensors,
    real_numbers,
    torch_threads,
    whole_numbers,
    zeros,
)
from pocketgs.torch.unsupported import first_derivative

LENSES: dict[str, KernelLens] = {
    "pinhole": Pinhole(),
    "ortho": Orthographic(),
    "fisheye": Fisheye(0.0, 0.0, 0.0, 0.0, -1.0),
}
"""The kernels' lenses by gsplat's camera models. Its fisheye is equidistant."""


@dataclass(frozen=True)
class Projection:
    """Settings of the projection; gsplat's arguments of the same names.

    Attributes:
        width, height: of the image, in pixels.
        eps2d: added to both variances on the image, in pixels².
        near_plane, far_plane: minimum and maximum depth of visible Gaussians.
        radius_clip: Gaussians with radii up to this in both directions, in pixels, are not visible.
        compensated: whether the opacities will be multiplied by the compensations.
        packed: whether the result has rows only for visible Gaussians.
        sparse_grad: whether the gradients of Gaussians are sparse tensors, with rows for visible ones.
        camera_model: a key of LENSES.
    """

    width: int
    height: int
    eps2d: float = 0.3
    near_plane: float = 0.01
    far_plane: float = 1e10
    radius_clip: float = 0.0
    compensated: bool = False
    packed: bool = False
    sparse_grad: bool = False
    camera_model: str = "pinhole"

    def __post_init__(self) -> None:
        settings = ("width", "height", "eps2d", "near_plane", "far_plane", "radius_clip")
        given = {name: getattr(self, name) for name in settings}
        whole = whole_numbers(1, width=given.pop("width"), height=given.pop("height"))
        for name, value in zip(settings, [*whole, *real_numbers(**given)], strict=True):
            object.__setattr__(self, name, value)  # the class is frozen


class ProjectedSplats(NamedTuple):
    """Projected Gaussians: M = B C N rows in that order, or, if packed, one row per visible Gaussian.

    Rows of invisible Gaussians are zeros.

    Attributes:
        centres: (M, 2) in pixels.
        depths: (M,) along the optical axis.
        conics: (M, 3) xx, xy, yy of the inverse covariance, in 1/pixels².
        compensations: (M,) factor on the opacity that compensates the blur: √(|Σ'| / |Σ' + eps2d|).
        radii: (M, 2) int32, half the width and height of the region with α of at least 1/255, in pixels, rounded up.
        seen: (V,) int64, ascending, visible rows among all B C N.
    """

    centres: Tensor
    depths: Tensor
    conics: Tensor
    compensations: Tensor
    radii: Tensor
    seen: Tensor


class Project2D(torch.autograd.Function):
    """`Project2D.apply(means, quats, scales, opacities, viewmats, Ks, projection)` returns `ProjectedSplats`.

    Arguments are float32: (..., N, 3), (..., N, 4) of any length, (..., N, 3), (..., N) or (..., 0) for opaque ones,
    (..., C, 4, 4), (..., C, 3, 3), and a `Projection`; B is the product of the dimensions that the dots stand for.
    Means, quaternions, scales and viewmats get gradients; opacities only bound the visible extent.
    """

    @staticmethod
    def forward(
        ctx: Any,
        means: Tensor,
        quats: Tensor,
        scales: Tensor,
        opacities: Tensor,
        viewmats: Tensor,
        Ks: Tensor,
        projection: Projection,
    ) -> ProjectedSplats:
        """Project every Gaussian into every camera of its batch."""
        threads = torch_threads()
        check_tensors(1, opacities=opacities)
        check_tensors(2, means=means, quats=quats, scales=scales)
        check_tensors(3, viewmats=viewmats, Ks=Ks)
        lead, cameras, count = tuple(means.shape[:-2]), viewmats.shape[-3], means.shape[-2]
        check_shape("means", means, (*lead, count, 3))
        check_shape("quats", quats, (*lead, count, 4))
        check_shape("scales", scales, (*lead, count, 3))
        check_shape("opacities", opacities, (*lead, count), (*lead, 0))
        check_shape("viewmats", viewmats, (*lead, cameras, 4, 4))
        check_shape("Ks", Ks, (*lead, cameras, 3, 3))
        views, lens = _views(viewmats, Ks, projection), LENSES[projection.camera_model]
        batches = math.prod(lead)
        inputs = (means, quats, scales)
        places, turns, sizes = (array_of(each).reshape(batches, count, each.shape[-1]) for each in inputs)
        opaque = array_of(opacities).reshape(batches, opacities.shape[-1])
        shape = (len(views), count)
        centres, depths = np.empty((*shape, 2), np.float32), np.empty(shape, np.float32)
        conics, radii = np.empty((*shape, 3), np.float32), np.empty((*shape, 2), np.int32)
        compensations = np.empty(shape, np.float32)
        for image, view in enumerate(views):
            batch = image // cameras
            project_ewa(
                places[batch],
                turns[batch],
                sizes[batch],
                opaque[batch],
                view,
                lens,
                projection.eps2d,
                projection.near_plane,
                projection.far_plane,
                projection.radius_clip,
                projection.compensated,
                threads,
                centres[image],
                depths[image],
                conics[image],
                compensations[image],
                radii[image],
            )
        seen = np.flatnonzero(radii.reshape(-1, 2)[:, 0])
        arrays = [centres.reshape(-1, 2), depths.reshape(-1), conics.reshape(-1, 3), compensations.reshape(-1)]
        arrays.append(radii.reshape(-1, 2))
        if projection.packed:
            arrays = [np.take(array, seen, axis=0) for array in arrays]
        splats = ProjectedSplats._make(map(torch.from_numpy, [*arrays, seen]))
        ctx.projection, ctx.views, ctx.shape_of_viewmats = projection, views, viewmats.shape
        ctx.save_for_backward(means, quats, scales, splats.conics, splats.compensations, splats.seen)
        ctx.mark_non_differentiable(splats.radii, splats.seen)
        return splats

    @staticmethod
    @first_derivative
    def backward(ctx: Any, *d_splats: Tensor) -> tuple[Tensor | None, ...]:
        """Gradients of the Gaussians, summed over cameras, and of the cameras' matrices."""
        *gaussians, conics, compensations, seen = (array_of(tensor) for tensor in ctx.saved_tensors)
        shape = gaussians[0].shape
        count, batches = shape[-2], math.prod(shape[:-2])
        means, quats, scales = (array.reshape(batches, count, array.shape[-1]) for array in gaussians)
        d_centres, d_depths, d_conics, d_compensations = (array_of(gradient) for gradient in d_splats[:4])
        projection, views = ctx.projection, ctx.views
        threads = torch_threads()
        if not projection.compensated:
            compensations, d_compensations = compensations[:0], d_compensations[:0]
        sized = len(seen) if projection.sparse_grad else batches * count
        gradients = zeros(sized, 3), zeros(sized, 4), zeros(sized, 3)
        d_matrices = np.zeros((len(views), 4, 4)) if ctx.needs_input_grad[4] else None
        bounds = np.searchsorted(seen, np.arange(len(views) + 1) * count)
        for image, view in enumerate(views):
            batch = image * batches // len(views)
            own = np.arange(bounds[image], bounds[image + 1])
            places = seen[own] - image * count
            by_piece = np.zeros((0 if d_matrices is None else -(-len(own) // PIECE), MATRIX))
            project_ewa_backward(
                means[batch],
                quats[batch],
                scales[batch],
                view,
                LENSES[projection.camera_model],
                projection.eps2d,
                threads,
                places,
                own if projection.packed else seen[own],
                own if projection.sparse_grad else places + batch * count,
                conics,
                compensations,
                d_centres,
                d_depths,
                d_conics,
                d_compensations,
                *gradients,
                by_piece,
            )
            if d_matrices is not None:
                d_matrices[image, :3] = by_piece.sum(axis=0).reshape(3, 4)
        d_viewmats = None
        if d_matrices is not None:
            d_viewmats = torch.from_numpy(d_matrices).float().reshape(ctx.shape_of_viewmats)
        if projection.sparse_grad:
            found = [_sparse(gradient, seen, count, len(views)) for gradient in gradients]
        else:
            found = [torch.from_numpy(gradient).reshape(*shape[:-1], gradient.shape[-1]) for gradient in gradients]
        return (*found, None, d_viewmats, None, None)


def _views(viewmats: Tensor, Ks: Tensor, projection: Projection) -> list[View]:
    """One view per camera of every batch."""
    matrices, intrinsics = (array_of(each.detach().double().flatten(0, -3)) for each in (viewmats, Ks))
    return [
        View(
            np.ascontiguousarray(matrix[:3, :3]),
            np.ascontiguousarray(matrix[:3, 3]),
            np.zeros(3),  # directions are computed elsewhere
            float(own[0, 0]),
            float(own[1, 1]),
            float(own[0, 2]),
            float(own[1, 2]),
            projection.width,
            projection.height,
            projection.compensated,
        )
        for matrix, own in zip(matrices, intrinsics, strict=True)
    ]


def _sparse(gradient: np.ndarray, seen: np.ndarray, count: int, cameras: int) -> Tensor:
    """A sparse tensor of the visible rows; a Gaussian's rows of several cameras add up."""
    places = torch.from_numpy(seen % count)[None]
    size = (count, gradient.shape[1])
    values = torch.from_numpy(gradient)
    return torch.sparse_coo_tensor(places, values, size, check_invariants=False, is_coalesced=cameras == 1)
