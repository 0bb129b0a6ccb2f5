"""Culling of clusters: runs of 256 Gaussians in memory that a camera cannot see are skipped.

    clusters = ClusterCuller.apply(means, scales, viewmat, K, width, height, near_plane)
    means, quats, scales = ClusterCompactor.apply(clusters, means, quats, scales)

It pays if Gaussians that are neighbours in space are neighbours in memory; see `pocketgs.morton_order`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import Tensor

from pocketgs.splat.cpu.clusters import BOUNDS, fit, outside
from pocketgs.splat.cpu.layout import CLUSTER, View
from pocketgs.splat.cpu.lenses.lens import Pinhole
from pocketgs.torch.arrays import array_of, real_numbers, torch_threads, whole_numbers
from pocketgs.torch.unsupported import first_derivative


class ClusterCuller(torch.autograd.Function):
    """`ClusterCuller.apply(means, scales, viewmat, K, width, height, near_plane)`: (M,) int64 clusters in view.

    Arguments are (N, 3) means and standard deviations, float32, a (4, 4) world_to_camera and (3, 3) intrinsics of a
    pinhole camera, the image's size, and the minimum depth. The result has no gradient.
    """

    @staticmethod
    def forward(
        ctx: Any, means: Tensor, scales: Tensor, viewmat: Tensor, K: Tensor, width: int, height: int, near_plane: float
    ) -> Tensor:
        """All clusters that the camera may see, ascending."""
        width, height = whole_numbers(1, width=width, height=height)
        (near_plane,) = real_numbers(near_plane=near_plane)
        matrix, intrinsics = array_of(viewmat.double()), array_of(K.double())
        rotation, shift = np.ascontiguousarray(matrix[:3, :3]), np.ascontiguousarray(matrix[:3, 3])
        (fx, fy), (cx, cy) = intrinsics.diagonal()[:2], intrinsics[:2, 2]
        view = View(rotation, shift, -np.linalg.solve(rotation, shift), fx, fy, cx, cy, width, height, False)
        clusters = np.arange(-(-len(means) // CLUSTER), dtype=np.int32)
        bounds = np.empty((len(clusters), BOUNDS), np.float32)
        with np.errstate(all="ignore"):
            log_scales = np.log(array_of(scales))
        fit(array_of(means), log_scales, clusters, torch_threads(), bounds)
        found = torch.from_numpy(np.flatnonzero(~outside(bounds, view, Pinhole(), near_plane)))
        ctx.mark_non_differentiable(found)
        return found


class ClusterCompactor(torch.autograd.Function):
    """`ClusterCompactor.apply(clusters, *tensors)`: the rows of these clusters in each tensor, concatenated.

    Tensors are (N, ...); the gradient of the other rows is 0.
    """

    @staticmethod
    def forward(ctx: Any, clusters: Tensor, *tensors: Tensor) -> tuple[Tensor, ...]:
        """The clusters' rows."""
        rows = (clusters[:, None] * CLUSTER + torch.arange(CLUSTER)).flatten()
        rows = rows[rows < len(tensors[0])]
        ctx.save_for_backward(rows)
        ctx.shapes = [tensor.shape for tensor in tensors]
        return tuple(tensor.index_select(0, rows) for tensor in tensors)

    @staticmethod
    @first_derivative
    def backward(ctx: Any, *d_outputs: Tensor) -> tuple[Tensor | None, ...]:
        """Copy each row's gradient back to its place."""
        (rows,) = ctx.saved_tensors
        gradients = []
        for shape, gradient in zip(ctx.shapes, d_outputs, strict=True):
            whole = gradient.new_zeros(shape)
            whole[rows] = gradient
            gradients.append(whole)
        return (None, *gradients)
