"""Compositing in float64 by the reference: slow, but exact enough for `torch.autograd.gradcheck`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from pocketgs.geometry.camera import Camera
from pocketgs.splat.limits import GSPLAT
from pocketgs.splat.reference.project import Projection
from pocketgs.splat.reference.rasterize import rasterize, rasterize_backward
from pocketgs.torch.arrays import array_of
from pocketgs.torch.unsupported import first_derivative


@dataclass(frozen=True)
class GivenLists:
    """Tile lists in gsplat's layout.

    Attributes:
        offsets: (I, tiles + 1) start of each tile's list in `given`, then the end of the image's last one.
        given: rows of splats, nearest first in each list.
        tile_size: side of a tile in pixels.
        size: width and height of the images.
    """

    offsets: np.ndarray
    given: np.ndarray
    tile_size: int
    size: tuple[int, int]


@dataclass(frozen=True)
class _Tile:
    """A tile as a separate image: its splats in order, and its pixels in the original image."""

    image: int
    rows: slice
    columns: slice
    splats: np.ndarray
    projection: Projection
    camera: Camera


class ReferenceRasterizer(torch.autograd.Function):
    """`ReferenceRasterizer.apply(centres, conics, colours, opacities, backgrounds, lists, absgrad)`.

    It is `TileRasterizer` for float64 tensors, with `GivenLists` in place of `Tiles`.
    """

    @staticmethod
    def forward(
        ctx: Any,
        centres: Tensor,
        conics: Tensor,
        colours: Tensor,
        opacities: Tensor,
        backgrounds: Tensor | None,
        lists: GivenLists,
        absgrad: bool,
    ) -> tuple[Tensor, Tensor]:
        """Composite all tiles."""
        channels, (width, height) = colours.shape[-1], lists.size
        shape = (len(lists.offsets), height, width)
        behind = colours.new_zeros(shape[0], channels) if backgrounds is None else backgrounds
        images, light = np.empty((*shape, channels)), np.empty(shape)
        for tile in _tiles(_arrays(centres, conics, colours, opacities), lists):
            raster = rasterize(tile.projection, tile.camera, behind[tile.image].numpy(), GSPLAT)
            images[tile.image, tile.rows, tile.columns] = raster.image
            light[tile.image, tile.rows, tile.columns] = raster.transmittance
        # As tensors, which PyTorch frees after backward.
        kept = [torch.from_numpy(array) for array in (lists.offsets, lists.given, light)]
        ctx.save_for_backward(centres, conics, colours, opacities, behind, *kept)
        ctx.tile_size, ctx.absgrad, ctx.has_background = lists.tile_size, absgrad, backgrounds is not None
        return torch.from_numpy(images), torch.from_numpy(1.0 - light)[..., None]

    @staticmethod
    @first_derivative
    def backward(ctx: Any, *d_outputs: Tensor) -> tuple[Tensor | None, ...]:
        """Replay all tiles."""
        d_images, d_alphas = (array_of(gradient) for gradient in d_outputs)
        *given, behind, offsets, listed, light = ctx.saved_tensors
        lists = GivenLists(offsets.numpy(), listed.numpy(), ctx.tile_size, (light.shape[2], light.shape[1]))
        arrays = _arrays(*given)
        d_centres, d_conics, d_colours, d_opacities = (np.zeros_like(array) for array in arrays)
        d_absolute = np.zeros_like(d_centres)
        for tile in _tiles(arrays, lists):
            raster = rasterize(tile.projection, tile.camera, behind[tile.image].numpy(), GSPLAT)
            d_image = d_images[tile.image, tile.rows, tile.columns]
            d_light = -d_alphas[tile.image, tile.rows, tile.columns, 0]
            found = rasterize_backward(tile.projection, tile.camera, raster, d_image, d_light, GSPLAT)
            np.add.at(d_centres, tile.splats, found.means)
            np.add.at(d_absolute, tile.splats, found.absolute_means)
            xx, xy, yy = found.conics[:, 0, 0], 2.0 * found.conics[:, 0, 1], found.conics[:, 1, 1]
            np.add.at(d_conics, tile.splats, np.stack([xx, xy, yy], axis=1))
            np.add.at(d_colours, tile.splats, found.colours)
            np.add.at(d_opacities, tile.splats, found.opacities)
        if ctx.absgrad:
            given[0].absgrad = torch.from_numpy(d_absolute).reshape(given[0].shape)
        d_backgrounds = torch.einsum("ihw,ihwd->id", light, d_outputs[0]) if ctx.has_background else None
        made = zip((d_centres, d_conics, d_colours, d_opacities), given, strict=True)
        return (*(torch.from_numpy(array).reshape(one.shape) for array, one in made), d_backgrounds, None, None)


def _arrays(*splats: Tensor) -> list[np.ndarray]:
    """Centres, conics, colours and opacities, with one row per splat."""
    count = splats[3].numel()
    tables = [array_of(tensor).reshape(count, tensor.shape[-1]) for tensor in splats[:3]]
    return [*tables, array_of(splats[3]).reshape(count)]


def _tiles(splats: list[np.ndarray], lists: GivenLists) -> Iterator[_Tile]:
    """All tiles of all images."""
    centres, conics, colours, opacities = splats
    (width, height), side = lists.size, lists.tile_size
    across = -(-width // side)
    for image, offsets in enumerate(lists.offsets):
        for number in range(len(offsets) - 1):
            own = lists.given[offsets[number] : offsets[number + 1]]
            left, top = number % across * side, number // across * side
            rows, columns = slice(top, min(top + side, height)), slice(left, min(left + side, width))
            camera = Camera(columns.stop - left, rows.stop - top, 1.0, 1.0, 0.0, 0.0, np.eye(4))
            xx, xy, yy = conics[own].T
            projection = Projection(
                centres[own] - (left, top),
                np.stack([xx, xy, xy, yy], axis=1).reshape(-1, 2, 2),
                opacities[own],
                np.ones(len(own)),
                colours[own],
                np.zeros((len(own), 2)),
                np.arange(len(own), dtype=float),  # the list defines the order
                np.ones(len(own), bool),
            )
            yield _Tile(image, rows, columns, own, projection, camera)
