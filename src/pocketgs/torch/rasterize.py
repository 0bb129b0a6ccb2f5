"""Rasterization of splats: compositing front to back, with all gradients."""

from __future__ import annotations

import threading
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from pocketgs.splat.cpu.bin import TileLists
from pocketgs.splat.cpu.layout import COLOURS
from pocketgs.splat.cpu.operators.splat_rows import gather_sums
from pocketgs.splat.cpu.rasterize import rasterize
from pocketgs.splat.cpu.rasterize_backward import rasterize_backward
from pocketgs.splat.cpu.tile_image import TileImage
from pocketgs.splat.cpu.tile_sums import sums_per_intersection
from pocketgs.splat.limits import GSPLAT
from pocketgs.torch.arrays import array_of, flat, torch_threads, zeros
from pocketgs.torch.covariance import in_full_precision
from pocketgs.torch.tiles import Tiles, splat_rows
from pocketgs.torch.unsupported import first_derivative

_NO_PLANE = np.empty((0, 0), np.float32)
_scratch = threading.local()


def _sums(size: int) -> np.ndarray:
    """A buffer for the sums of tiles, kept between backward passes: fresh memory costs page faults."""
    kept: np.ndarray | None = getattr(_scratch, "sums", None)
    if kept is None or len(kept) < size:
        kept = _scratch.sums = np.empty(size * 5 // 4, np.float32)
    return kept


class _Tape(NamedTuple):
    """State for the replay of an image: its tile lists, and the ends of what was drawn of them."""

    intersections: np.ndarray
    ranges: np.ndarray
    slots: np.ndarray
    visible: np.ndarray
    drawn_ends: np.ndarray

    @property
    def lists(self) -> TileLists:
        """The tile lists."""
        return TileLists(self.intersections, self.ranges, self.slots)


class TileRasterizer(torch.autograd.Function):
    """`TileRasterizer.apply(centres, conics, colours, opacities, backgrounds, tiles, absgrad)`: images and alphas.

    Arguments are float32: (..., 2), (..., 3), (..., D), (...), (I, D) or None, then `Tiles`, and whether backward
    stores the summed magnitudes of the gradients of the centres in `centres.absgrad`. The dots stand for all rows.
    Images are (I, H, W, D) and alphas (I, H, W, 1). All tensors have gradients.
    """

    @staticmethod
    def forward(
        ctx: Any,
        centres: Tensor,
        conics: Tensor,
        colours: Tensor,
        opacities: Tensor,
        backgrounds: Tensor | None,
        tiles: Tiles,
        absgrad: bool,
    ) -> tuple[Tensor, Tensor]:
        """Composite the splats of each image front to back: C = Σ c_i α_i T_i + T · background."""
        threads, channels = torch_threads(), colours.shape[-1]
        arrays = [flat(centres, 2), flat(conics, 3), array_of(opacities).reshape(-1)]
        splats, _ = splat_rows(arrays, flat(colours, channels), threads)
        shape = (len(tiles.lists), tiles.height, tiles.width)
        behind = np.zeros((shape[0], max(channels, COLOURS)), np.float32)
        if backgrounds is not None:
            behind[:, :channels] = array_of(backgrounds)
        # Channels are innermost in memory, as in gsplat's images.
        drawn, light, tapes = np.empty((*shape, behind.shape[1]), np.float32), np.empty(shape, np.float32), []
        for image, (lists, (first, end)) in enumerate(zip(tiles.lists, pairwise(tiles.first_rows), strict=True)):
            ends = np.empty(len(lists.ranges) - 1, np.int32)
            target = TileImage(drawn[image].transpose(2, 0, 1), light[image], ends)
            rasterize(splats[first:end], lists, behind[image], GSPLAT, threads, target)
            tapes.append(_Tape(*lists, tiles.visible[image], ends))
        # As tensors, which PyTorch frees after backward.
        kept = [torch.from_numpy(array) for array in (splats, drawn, light, *(each for tape in tapes for each in tape))]
        ctx.save_for_backward(centres, conics, colours, opacities, *kept)
        ctx.first_rows, ctx.absgrad, ctx.has_background = tiles.first_rows, absgrad, backgrounds is not None
        ctx.set_materialize_grads(False)
        # Backward needs the image as it was drawn, and callers may change theirs.
        return torch.from_numpy(drawn[..., :channels].copy()), torch.from_numpy(1.0 - light)[..., None]

    @staticmethod
    @first_derivative
    @in_full_precision
    def backward(ctx: Any, *d_outputs: Tensor) -> tuple[Tensor | None, ...]:
        """Replay all images."""
        centres, conics, colours, opacities, *tensors = ctx.saved_tensors
        splats, drawn, light, *kept = (tensor.numpy() for tensor in tensors)
        threads, channels = torch_threads(), colours.shape[-1]
        shapes, opaque = flat(conics, 3), array_of(opacities).reshape(-1)
        d_images, d_alphas = d_outputs
        rows, row = len(shapes), sums_per_intersection(drawn.shape[-1])
        d_centres, d_conics, d_colours, d_opacities = zeros(rows, 2), zeros(rows, 3), zeros(rows, channels), zeros(rows)
        d_absolute = zeros(rows if ctx.absgrad else 0, 2)
        for image in range(len(drawn)):
            tape = _Tape._make(kept[image * len(_Tape._fields) : (image + 1) * len(_Tape._fields)])
            own = slice(ctx.first_rows[image], ctx.first_rows[image + 1])
            sums = _sums(len(tape.intersections) * row)
            planes = np.zeros(drawn.shape[1:], np.float32)
            if d_images is not None and channels == drawn.shape[-1]:
                planes = array_of(d_images[image])
            elif d_images is not None:
                planes[..., :channels] = d_images[image].numpy()
            d_transmittance = _NO_PLANE if d_alphas is None else -array_of(d_alphas[image, ..., 0])
            made = TileImage(drawn[image].transpose(2, 0, 1), light[image], tape.drawn_ends)
            gradients = (planes.transpose(2, 0, 1), d_transmittance)
            rasterize_backward(splats[own], tape.lists, GSPLAT, threads, made, *gradients, ctx.absgrad, sums)
            gather_sums(
                shapes[own],
                opaque[own],
                tape.visible,
                tape.slots,
                row,
                sums,
                threads,
                d_centres[own],
                d_absolute[own] if ctx.absgrad else d_absolute,
                d_conics[own],
                d_opacities[own],
                d_colours[own],
            )
        if ctx.absgrad:
            centres.absgrad = torch.from_numpy(d_absolute).reshape(centres.shape)
        d_backgrounds = None
        if ctx.has_background and d_images is not None:
            d_backgrounds = torch.einsum("ihw,ihwd->id", torch.from_numpy(light), d_images)
        given = (centres, conics, colours, opacities)
        found = zip((d_centres, d_conics, d_colours, d_opacities), given, strict=True)
        return (*(torch.from_numpy(array).reshape(one.shape) for array, one in found), d_backgrounds, None, None)
