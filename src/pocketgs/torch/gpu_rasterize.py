"""Rasterization of splats on a GPU through WebGPU, with all gradients."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import torch
from torch import Tensor

from pocketgs.splat.cpu.layout import DEPTH, EXPONENT_XX, EXPONENT_XY, EXPONENT_YY, LOG2_OPACITY, MEAN_X, MEAN_Y
from pocketgs.splat.cpu.project import CULLED
from pocketgs.splat.webgpu.compositor import NOT_DRAWN, SplatCompositor, Splats
from pocketgs.torch.arrays import array_of, flat, torch_threads, zeros
from pocketgs.torch.tiles import NO_COLOURS, splat_rows

_SHAPE = (MEAN_X, MEAN_Y, DEPTH, LOG2_OPACITY, EXPONENT_XX, EXPONENT_XY, EXPONENT_YY)
"""Columns of the CPU's rows in the order of the GPU's."""

_BY_CONIC = np.array([-0.5, -1.0, -0.5], np.float32)
"""Derivatives of the exponent -½ (xx dx² + yy dy²) - xy dx dy by xx, xy and yy, without dx and dy."""


class GpuRasterizer(torch.autograd.Function):
    """`GpuRasterizer.apply(centres, conics, colours, opacities, depths, backgrounds, first_rows, size, absgrad, gpu)`.

    It is `TileBinner` and `TileRasterizer` in one; `size` is the width and height of every image, and `gpu` composites.
    The depths only define the order.
    """

    @staticmethod
    def forward(
        ctx: Any,
        centres: Tensor,
        conics: Tensor,
        colours: Tensor,
        opacities: Tensor,
        depths: Tensor,
        backgrounds: Tensor | None,
        first_rows: Sequence[int],
        size: tuple[int, int],
        absgrad: bool,
        gpu: SplatCompositor,
    ) -> tuple[Tensor, Tensor]:
        """Composite the splats of each image front to back: C = Σ c_i α_i T_i + T · background."""
        channels = colours.shape[-1]
        values = flat(colours, channels)
        shapes, keys = _shapes(centres, conics, opacities, depths)
        behind = np.zeros((len(first_rows) - 1, channels), np.float32)
        if backgrounds is not None:
            behind[:] = array_of(backgrounds)
        # Backward may draw them again, so they share no memory with tensors that callers may change.
        drawn = [Splats(*size, shapes[a:b], keys[a:b], values[a:b].copy()) for a, b in pairwise(first_rows)]
        images, light = zeros(len(drawn), size[1], size[0], channels), zeros(len(drawn), size[1], size[0])
        for image, splats in enumerate(drawn):
            planes, light[image] = gpu.forward(splats)
            images[image] = np.moveaxis(planes, 0, 2) + light[image, ..., None] * behind[image]
        ctx.save_for_backward(centres, conics, colours, opacities)
        ctx.drawn, ctx.light, ctx.behind, ctx.gpu = drawn, torch.from_numpy(light), torch.from_numpy(behind), gpu
        ctx.first_rows, ctx.absgrad, ctx.has_background = first_rows, absgrad, backgrounds is not None
        return torch.from_numpy(images), 1.0 - ctx.light[..., None]

    @staticmethod
    def backward(ctx: Any, *d_outputs: Tensor) -> tuple[Tensor | None, ...]:
        """Replay all images."""
        given = ctx.saved_tensors
        centres, _, colours, opacities = given
        d_images, d_alphas = d_outputs
        rows, channels = opacities.numel(), colours.shape[-1]
        d_centres, d_absolute, d_conics = zeros(rows, 2), zeros(rows, 2), zeros(rows, 3)
        d_colours, d_opacities = zeros(rows, channels), zeros(rows)
        d_light = torch.einsum("ihwd,id->ihw", d_images, ctx.behind) - d_alphas[..., 0]
        for image, splats in enumerate(ctx.drawn):
            own = slice(ctx.first_rows[image], ctx.first_rows[image + 1])
            planes = np.moveaxis(array_of(d_images[image]), 2, 0)
            found = ctx.gpu.backward(splats, planes, array_of(d_light[image]), ctx.absgrad)
            d_centres[own], d_absolute[own] = found.centres, found.absolute_centres
            d_conics[own] = found.moments * _BY_CONIC
            d_opacities[own], d_colours[own] = found.log_opacities, found.channels
        np.divide(d_opacities, array_of(opacities).reshape(-1), out=d_opacities, where=d_opacities != 0.0)
        if ctx.absgrad:
            centres.absgrad = torch.from_numpy(d_absolute).reshape(centres.shape)
        d_backgrounds = torch.einsum("ihw,ihwd->id", ctx.light, d_images) if ctx.has_background else None
        made = zip((d_centres, d_conics, d_colours, d_opacities), given, strict=True)
        gradients = (torch.from_numpy(array).reshape(one.shape) for array, one in made)
        return (*gradients, None, d_backgrounds, None, None, None, None)


def _shapes(centres: Tensor, conics: Tensor, opacities: Tensor, depths: Tensor) -> tuple[np.ndarray, np.ndarray]:
    """The shapes and keys of `Splats`."""
    arrays = [flat(centres, 2), flat(conics, 3), *(array_of(each).reshape(-1) for each in (opacities, depths))]
    rows, keys = splat_rows(arrays, NO_COLOURS, torch_threads())
    shapes = np.ascontiguousarray(rows[:, _SHAPE])
    absent = np.zeros(len(_SHAPE), np.float32)
    absent[_SHAPE.index(LOG2_OPACITY)] = NOT_DRAWN
    shapes[keys == CULLED] = absent
    return shapes, keys
