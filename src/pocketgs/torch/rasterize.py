"""Splats to pixels: which tiles they reach, and compositing front to back, with every gradient."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import torch
from torch import Tensor

from pocketgs.splat.cpu.bin import Binner, TileLists
from pocketgs.splat.cpu.given_lists import lists_from
from pocketgs.splat.cpu.layout import CLUSTER, COLOURS, FIRST_CHANNEL, View
from pocketgs.splat.cpu.project import CULLED
from pocketgs.splat.cpu.rasterize import rasterize
from pocketgs.splat.cpu.rasterize_backward import rasterize_backward, sums_per_intersection
from pocketgs.splat.cpu.sort import sort_by_depth
from pocketgs.splat.cpu.splat_rows import gather_sums, write_rows
from pocketgs.splat.limits import Limits
from pocketgs.torch.arrays import array_of, torch_threads, zeros

GSPLAT = Limits(np.float32(0.999), True)
"""Where gsplat's compositing stops."""

_NO_DEPTHS, _NO_COLOURS = np.empty(0, np.float32), np.empty((0, 0), np.float32)


@dataclass(frozen=True)
class Tiles:
    """Which splats the tiles of some images draw.

    Attributes:
        width, height: of every image.
        first_rows: (I + 1) where each image's splats begin among all rows, and where the last one's end.
        lists: of each image; splats count from the image's first row.
        visible: (V,) int32 for each image, splats that are drawn.
    """

    width: int
    height: int
    first_rows: Sequence[int]
    lists: Sequence[TileLists]
    visible: Sequence[np.ndarray]


class TileBinner(torch.autograd.Function):
    """`TileBinner.apply(centres, conics, opacities, depths, first_rows, width, height)` gives `Tiles`.

    Arguments are those of a `Splats`, float32, for all images one after the other. Nothing here has a gradient.
    """

    @staticmethod
    def forward(
        ctx: Any,
        centres: Tensor,
        conics: Tensor,
        opacities: Tensor,
        depths: Tensor,
        first_rows: Sequence[int],
        width: int,
        height: int,
    ) -> Tiles:
        """Sort every image's splats by depth, and list them for the tiles that they reach."""
        threads = torch_threads()
        arrays = [_flat(centres, 2), _flat(conics, 3), *(array_of(each).reshape(-1) for each in (opacities, depths))]
        lists, visible = [], []
        for first, end in pairwise(first_rows):
            splats, keys = _rows([array[first:end] for array in arrays], _NO_COLOURS, threads)
            clusters = np.arange(-(-len(keys) // CLUSTER), dtype=np.int32)
            seen, order = sort_by_depth(keys, clusters, *np.empty((3, len(keys)), np.int32))
            lists.append(Binner(threads).bin(splats, seen, order, _image(width, height)))
            visible.append(seen)
        return Tiles(width, height, first_rows, lists, visible)


def tiles_from(
    splats: tuple[Tensor, Tensor, Tensor],
    first_rows: Sequence[int],
    offsets: np.ndarray,
    given: np.ndarray,
    tile_size: int,
    size: tuple[int, int],
) -> Tiles:
    """Tiles from intersections in gsplat's layout.

    Args:
        splats: centres, conics and opacities, as `TileBinner` takes them.
        first_rows: where each image's splats begin.
        offsets: (I, tiles + 1) int32, where each tile's list begins in `given`, and where the image's last one ends.
        given: int32 rows of splats.
        tile_size: side of gsplat's tiles, a multiple of 16.
        size: width and height of every image.
    """
    threads = torch_threads()
    centres, conics, opacities = splats
    arrays: list[np.ndarray] = [_flat(centres, 2), _flat(conics, 3), array_of(opacities).reshape(-1)]
    lists, visible = [], []
    for image, (first, end) in enumerate(pairwise(first_rows)):
        rows, keys = _rows([array[first:end] for array in arrays], _NO_COLOURS, threads)
        bounds = offsets[image]
        own = given[bounds[0] : bounds[-1]] - np.int32(first)
        lists.append(lists_from(rows, keys, bounds - bounds[0], own, tile_size, size, threads))
        visible.append(np.flatnonzero(keys != CULLED).astype(np.int32))
    return Tiles(*size, first_rows, lists, visible)


def _rows(arrays: Sequence[np.ndarray], colours: np.ndarray, threads: int) -> tuple[np.ndarray, np.ndarray]:
    """The splats' rows and depth keys, as kernels take them, of centres, conics, opacities and maybe depths."""
    centres, conics, opacities = arrays[:3]
    depths = arrays[3] if len(arrays) > 3 else _NO_DEPTHS
    splats = np.empty((len(centres), FIRST_CHANNEL + max(COLOURS, colours.shape[1])), np.float32)
    keys = np.empty(len(centres), np.uint32)
    write_rows(centres, conics, opacities, depths, colours, threads, splats, keys)
    return splats, keys


def _image(width: int, height: int) -> View:
    """A view of which only the size counts."""
    return View(np.eye(3), np.zeros(3), np.zeros(3), 1.0, 1.0, 0.0, 0.0, width, height)


@dataclass(frozen=True)
class _Tape:
    splats: np.ndarray
    image: np.ndarray
    transmittance: np.ndarray
    drawn_ends: np.ndarray


class TileRasterizer(torch.autograd.Function):
    """`TileRasterizer.apply(centres, conics, colours, opacities, backgrounds, tiles, absgrad)`: images and alphas.

    Arguments are float32: (..., 2), (..., 3), (..., D), (...), (I, D) or None, then `Tiles`, and whether backward is to
    leave the summed magnitudes of the gradients of the centres in `centres.absgrad`. The dots stand for all rows. Images
    are (I, H, W, D) and alphas (I, H, W, 1). All tensors have gradients.
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
        """Composite every image's splats front to back: C = Σ c_i α_i T_i + T · background."""
        threads, channels = torch_threads(), colours.shape[-1]
        arrays: list[np.ndarray] = [_flat(centres, 2), _flat(conics, 3), array_of(opacities).reshape(-1)]
        values = _flat(colours, channels)
        shape = (tiles.height, tiles.width)
        behind = np.zeros((len(tiles.lists), max(channels, COLOURS)), np.float32)
        if backgrounds is not None:
            behind[:, :channels] = array_of(backgrounds)
        tapes = []
        for image, lists in enumerate(tiles.lists):
            own = slice(tiles.first_rows[image], tiles.first_rows[image + 1])
            splats, _ = _rows([array[own] for array in arrays], values[own], threads)
            planes = np.empty((behind.shape[1], *shape), np.float32)
            transmittance, ends = np.empty(shape, np.float32), np.empty(len(lists.ranges) - 1, np.int32)
            drawn = (lists.intersections, lists.ranges, behind[image], GSPLAT)
            rasterize(splats, *drawn, threads, planes, transmittance, ends)
            tapes.append(_Tape(splats, planes, transmittance, ends))
        ctx.tapes, ctx.tiles, ctx.absgrad, ctx.has_background = tapes, tiles, absgrad, backgrounds is not None
        ctx.save_for_backward(centres, conics, colours, opacities)
        images = [torch.from_numpy(tape.image[:channels]).permute(1, 2, 0) for tape in tapes]
        alphas = [torch.from_numpy(tape.transmittance) for tape in tapes]
        return torch.stack(images), 1.0 - torch.stack(alphas)[..., None]

    @staticmethod
    def backward(ctx: Any, *d_outputs: Tensor) -> tuple[Tensor | None, ...]:
        """Replay every image."""
        centres, conics, colours, opacities = ctx.saved_tensors
        tiles, threads, channels = ctx.tiles, torch_threads(), colours.shape[-1]
        shapes, opaque = _flat(conics, 3), array_of(opacities).reshape(-1)
        d_images, d_alphas = d_outputs
        rows = len(shapes)
        d_centres, d_conics, d_colours, d_opacities = zeros(rows, 2), zeros(rows, 3), zeros(rows, channels), zeros(rows)
        d_absolute = zeros(rows if ctx.absgrad else 0, 2)
        for image, (tape, lists) in enumerate(zip(ctx.tapes, tiles.lists, strict=True)):
            own = slice(tiles.first_rows[image], tiles.first_rows[image + 1])
            row = sums_per_intersection(len(tape.image))
            sums = np.empty(len(lists.intersections) * row, np.float32)
            planes = array_of(d_images[image].permute(2, 0, 1))
            if channels < COLOURS:
                planes = np.concatenate([planes, zeros(COLOURS - channels, *planes.shape[1:])])
            d_transmittance = array_of(-d_alphas[image, ..., 0])
            drawn = (tape.splats, lists.intersections, lists.ranges, tape.drawn_ends, GSPLAT)
            made = (tape.image, planes, tape.transmittance, d_transmittance)
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
        if ctx.has_background:
            light = torch.stack([torch.from_numpy(tape.transmittance) for tape in ctx.tapes])
            d_backgrounds = torch.einsum("ihw,ihwd->id", light, d_images)
        found = zip((d_centres, d_conics, d_colours, d_opacities), ctx.saved_tensors, strict=True)
        return (*(torch.from_numpy(array).reshape(given.shape) for array, given in found), d_backgrounds, None, None)


def _flat(tensor: Tensor, columns: int) -> np.ndarray:
    """(M, columns) of a (..., columns) tensor."""
    return array_of(tensor).reshape(-1, columns)
