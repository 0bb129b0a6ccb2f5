"""Rasterization of splats: compositing front to back, with all gradients."""

from __future__ import annotations

import threading
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from pocketgs.splat.cpu.layout import COLOURS
from pocketgs.splat.cpu.operators.splat_rows import gather_sums
from pocketgs.splat.cpu.rasterize import rasterize
from pocketgs.splat.cpu.rasterize_backward import rasterize_backward, sums_per_intersection
from pocketgs.splat.limits import GSPLAT
from pocketgs.torch.arrays import array_of, flat, torch_threads, zeros
from pocketgs.torch.tiles import Tiles, splat_rows

_NO_PLANE = np.empty((0, 0), np.float32)
_scratch = threading.local()


def _sums(size: int) -> np.ndarray:
    """A buffer for the sums of tiles, kept between backward passes: fresh memory costs page faults."""
    kept: np.ndarray | None = getattr(_scratch, "sums", None)
    if kept is None or len(kept) < size:
        kept = _scratch.sums = np.empty(size * 5 // 4, np.float32)
    return kept


@dataclass(frozen=True)
class _Tape:
    """State for the replay of an image. Channels are innermost in memory, as in gsplat's images."""

    splats: np.ndarray
    image: np.ndarray
    transmittance: np.ndarray
    drawn_ends: np.ndarray


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
        arrays: list[np.ndarray] = [flat(centres, 2), flat(conics, 3), array_of(opacities).reshape(-1)]
        values = flat(colours, channels)
        shape = (tiles.height, tiles.width)
        behind = np.zeros((len(tiles.lists), max(channels, COLOURS)), np.float32)
        if backgrounds is not None:
            behind[:, :channels] = array_of(backgrounds)
        tapes = []
        for image, lists in enumerate(tiles.lists):
            own = slice(tiles.first_rows[image], tiles.first_rows[image + 1])
            splats, _ = splat_rows([array[own] for array in arrays], values[own], threads)
            planes = np.empty((*shape, behind.shape[1]), np.float32).transpose(2, 0, 1)
            transmittance, ends = np.empty(shape, np.float32), np.empty(len(lists.ranges) - 1, np.int32)
            drawn = (lists.intersections, lists.ranges, behind[image], GSPLAT)
            rasterize(splats, *drawn, threads, planes, transmittance, ends)
            tapes.append(_Tape(splats, planes, transmittance, ends))
        ctx.tapes, ctx.tiles, ctx.absgrad, ctx.has_background = tapes, tiles, absgrad, backgrounds is not None
        images = _batch([tape.image[:channels].transpose(1, 2, 0) for tape in tapes])
        alphas = _batch([1.0 - tape.transmittance for tape in tapes])
        # A single image shares its memory with the tape. Saving it makes PyTorch raise if it was changed in place.
        ctx.save_for_backward(centres, conics, colours, opacities, images)
        ctx.set_materialize_grads(False)
        return images, alphas[..., None]

    @staticmethod
    def backward(ctx: Any, *d_outputs: Tensor) -> tuple[Tensor | None, ...]:
        """Replay all images."""
        given = ctx.saved_tensors[:-1]
        centres, conics, colours, opacities = given
        tiles, threads, channels = ctx.tiles, torch_threads(), colours.shape[-1]
        shapes, opaque = flat(conics, 3), array_of(opacities).reshape(-1)
        d_images, d_alphas = d_outputs
        rows = len(shapes)
        d_centres, d_conics, d_colours, d_opacities = zeros(rows, 2), zeros(rows, 3), zeros(rows, channels), zeros(rows)
        d_absolute = zeros(rows if ctx.absgrad else 0, 2)
        for image, (tape, lists) in enumerate(zip(ctx.tapes, tiles.lists, strict=True)):
            own = slice(tiles.first_rows[image], tiles.first_rows[image + 1])
            row = sums_per_intersection(len(tape.image))
            sums = _sums(len(lists.intersections) * row)
            planes = np.zeros((*tape.transmittance.shape, len(tape.image)), np.float32)
            if d_images is not None and channels == len(tape.image):
                planes = array_of(d_images[image])
            elif d_images is not None:
                planes[..., :channels] = d_images[image].numpy()
            d_transmittance = _NO_PLANE if d_alphas is None else -array_of(d_alphas[image, ..., 0])
            drawn = (tape.splats, lists.intersections, lists.ranges, tape.drawn_ends, GSPLAT)
            made = (tape.image, planes.transpose(2, 0, 1), tape.transmittance, d_transmittance)
            rasterize_backward(*drawn, threads, *made, ctx.absgrad, sums)
            gather_sums(
                shapes[own],
                opaque[own],
                tiles.visible[image],
                lists.slots,
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
            light = _batch([tape.transmittance for tape in ctx.tapes])
            d_backgrounds = torch.einsum("ihw,ihwd->id", light, d_images)
        found = zip((d_centres, d_conics, d_colours, d_opacities), given, strict=True)
        return (*(torch.from_numpy(array).reshape(one.shape) for array, one in found), d_backgrounds, None, None)


def _batch(arrays: list[np.ndarray]) -> Tensor:
    """The arrays as one tensor, not copied if there is only one."""
    return torch.from_numpy(arrays[0][None] if len(arrays) == 1 else np.stack(arrays))
