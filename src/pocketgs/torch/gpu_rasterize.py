"""Rasterization of splats on a GPU through WebGPU, with all gradients."""

from __future__ import annotations

import weakref
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import torch
from torch import Tensor

from pocketgs.splat.constants import CULLED
from pocketgs.splat.cpu.layout import DEPTH, EXPONENT_XX, EXPONENT_XY, EXPONENT_YY, LOG2_OPACITY, MEAN_X, MEAN_Y
from pocketgs.splat.webgpu.compositor import NOT_DRAWN, SplatCompositor, Splats
from pocketgs.torch.arrays import array_of, flat, torch_threads, zeros
from pocketgs.torch.covariance import in_full_precision
from pocketgs.torch.tiles import NO_COLOURS, splat_rows
from pocketgs.torch.unsupported import first_derivative

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
        drawn = _splats(centres, conics, colours, opacities, depths, first_rows, size)
        behind = colours.new_zeros(len(drawn), channels) if backgrounds is None else backgrounds
        images, light = zeros(len(drawn), size[1], size[0], channels), zeros(len(drawn), size[1], size[0])
        for image, splats in enumerate(drawn):
            planes, light[image] = gpu.forward(splats)
            images[image] = np.moveaxis(planes, 0, 2) + light[image, ..., None] * array_of(behind[image])
        ctx.save_for_backward(centres, conics, colours, opacities, depths, behind, torch.from_numpy(light))
        # The compositor keeps the splats that it drew last, and backward makes all others again.
        ctx.drawn, ctx.gpu, ctx.first_rows, ctx.size = [weakref.ref(each) for each in drawn], gpu, first_rows, size
        ctx.absgrad, ctx.has_background = absgrad, backgrounds is not None
        return torch.from_numpy(images), torch.from_numpy(1.0 - light)[..., None]

    @staticmethod
    @first_derivative
    @in_full_precision
    def backward(ctx: Any, *d_outputs: Tensor) -> tuple[Tensor | None, ...]:
        """Replay all images."""
        centres, conics, colours, opacities, depths, behind, light = ctx.saved_tensors
        drawn = [each() for each in ctx.drawn]
        if not all(drawn):
            drawn = _splats(centres, conics, colours, opacities, depths, ctx.first_rows, ctx.size)
        d_images, d_alphas = d_outputs
        rows, channels = opacities.numel(), colours.shape[-1]
        d_centres, d_absolute, d_conics = zeros(rows, 2), zeros(rows, 2), zeros(rows, 3)
        d_colours, d_opacities = zeros(rows, channels), zeros(rows)
        d_light = torch.einsum("ihwd,id->ihw", d_images, behind) - d_alphas[..., 0]
        for image, splats in enumerate(drawn):
            own = slice(ctx.first_rows[image], ctx.first_rows[image + 1])
            planes = np.moveaxis(array_of(d_images[image]), 2, 0)
            found = ctx.gpu.backward(splats, planes, array_of(d_light[image]), ctx.absgrad)
            d_centres[own], d_absolute[own] = found.centres, found.absolute_centres
            d_conics[own] = found.moments * _BY_CONIC
            d_opacities[own], d_colours[own] = found.log_opacities, found.channels
        np.divide(d_opacities, array_of(opacities).reshape(-1), out=d_opacities, where=d_opacities != 0.0)
        if ctx.absgrad:
            centres.absgrad = torch.from_numpy(d_absolute).reshape(centres.shape)
        d_backgrounds = torch.einsum("ihw,ihwd->id", light, d_images) if ctx.has_background else None
        given = (centres, conics, colours, opacities)
        made = zip((d_centres, d_conics, d_colours, d_opacities), given, strict=True)
        gradients = (torch.from_numpy(array).reshape(one.shape) for array, one in made)
        return (*gradients, None, d_backgrounds, None, None, None, None)


def _splats(
    centres: Tensor,
    conics: Tensor,
    colours: Tensor,
    opacities: Tensor,
    depths: Tensor,
    first_rows: Sequence[int],
    size: tuple[int, int],
) -> list[Splats]:
    """The splats of each image."""
    arrays = [flat(centres, 2), flat(conics, 3), *(array_of(each).reshape(-1) for each in (opacities, depths))]
    rows, keys = splat_rows(arrays, NO_COLOURS, torch_threads())
    shapes = np.ascontiguousarray(rows[:, _SHAPE])
    absent = np.zeros(len(_SHAPE), np.float32)
    absent[_SHAPE.index(LOG2_OPACITY)] = NOT_DRAWN
    shapes[keys == CULLED] = absent
    values = flat(colours, colours.shape[-1])
    return [Splats(*size, shapes[a:b], keys[a:b], values[a:b]) for a, b in pairwise(first_rows)]
