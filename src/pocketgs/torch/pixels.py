"""gsplat's `rasterize_to_pixels`, in single and double precision."""

from __future__ import annotations

import math

import numpy as np
import torch
from torch import Tensor

from pocketgs.errors import PocketGSError
from pocketgs.splat.cpu.layout import TILE_HEIGHT
from pocketgs.torch.arrays import array_of, check_shape, check_tensors, checked_dtype, whole_numbers
from pocketgs.torch.colours import check_channels
from pocketgs.torch.rasterize import TileRasterizer
from pocketgs.torch.reference import GivenLists, ReferenceRasterizer
from pocketgs.torch.tiles import tiles_from


def rasterize_to_pixels(
    means2d: Tensor,
    conics: Tensor,
    colors: Tensor,
    opacities: Tensor,
    image_width: int,
    image_height: int,
    tile_size: int,
    isect_offsets: Tensor,
    flatten_ids: Tensor,
    backgrounds: Tensor | None = None,
    masks: Tensor | None = None,
    packed: bool = False,
    absgrad: bool = False,
) -> tuple[Tensor, Tensor]:
    """Composite the splats of each pixel's tile list front to back.

    Args:
        means2d: (..., N, 2) centres in pixels; with `packed` (nnz, 2), as the following.
        conics: (..., N, 3) xx, xy, yy of the inverse covariances.
        colors: (..., N, D), any D.
        opacities: (..., N).
        image_width: of every image.
        image_height: of every image.
        tile_size: side of a tile; in float32 a multiple of 16.
        isect_offsets: (..., tile_height, tile_width) int32 from `isect_offset_encode`.
        flatten_ids: (E,) int32 from `isect_tiles`.
        backgrounds: (..., D) behind the splats, or None for black.
        masks: (..., tile_height, tile_width) bool, tiles to draw; the others show the background.
        packed: whether only visible Gaussians have rows.
        absgrad: whether backward stores the summed magnitudes of the pixels' gradients in `means2d.absgrad`.

    Returns:
        Colours (..., H, W, D) and alphas (..., H, W, 1).

    Raises:
        PocketGSError: shapes or types disagree, or a size is not a positive integer or not one of these.
    """
    tensors = {"means2d": means2d, "conics": conics, "colors": colors, "opacities": opacities}
    check_tensors(1, **tensors, flatten_ids=flatten_ids)
    check_tensors(1, optional=True, backgrounds=backgrounds)
    check_tensors(2, isect_offsets=isect_offsets)
    check_tensors(2, optional=True, masks=masks)
    dtype = checked_dtype({**tensors, "backgrounds": backgrounds})
    shape, channels, lead = tuple(opacities.shape), colors.shape[-1], tuple(isect_offsets.shape[:-2])
    check_shape("means2d", means2d, (*shape, 2))
    check_shape("conics", conics, (*shape, 3))
    check_shape("colors", colors, (*shape, channels))
    check_channels(channels)
    if backgrounds is not None:
        check_shape("backgrounds", backgrounds, (*lead, channels))
        backgrounds = backgrounds.reshape(-1, channels)
    width, height, side = whole_numbers(1, image_width=image_width, image_height=image_height, tile_size=tile_size)
    unit = 1 if dtype == torch.float64 else TILE_HEIGHT  # the kernels' tiles must not cross borders of given ones
    if side % unit:
        raise PocketGSError(f"tile_size: found {side}, expected a multiple of {unit}")
    grid = (math.ceil(height / side), math.ceil(width / side))
    check_shape("isect_offsets", isect_offsets, (*lead, *grid))
    images, in_image = math.prod(lead), math.prod(grid)
    offsets = np.empty((images, in_image + 1), np.int32)
    offsets[:, :-1] = array_of(isect_offsets).reshape(images, in_image)
    offsets[:, -1] = [*offsets[1:, 0], len(flatten_ids)]
    given = array_of(flatten_ids)
    if masks is not None:
        check_shape("masks", masks, (*lead, *grid))
        if masks.dtype != torch.bool:
            raise PocketGSError(f"masks: found {masks.dtype}, expected torch.bool")
        offsets, given = _masked(offsets, given, array_of(masks).reshape(images, in_image))
    size = (width, height)
    firsts = _first_rows(offsets, given, math.prod(shape))
    if dtype == torch.float64:
        lists = GivenLists(offsets, given, side, size)
        colours, alphas = ReferenceRasterizer.apply(means2d, conics, colors, opacities, backgrounds, lists, absgrad)
    else:
        tiles = tiles_from((means2d, conics, opacities), firsts, offsets, given, side, size)
        colours, alphas = TileRasterizer.apply(means2d, conics, colors, opacities, backgrounds, tiles, absgrad)
    return colours.reshape(*lead, *colours.shape[1:]), alphas.reshape(*lead, *alphas.shape[1:])


def _first_rows(offsets: np.ndarray, given: np.ndarray, rows: int) -> list[int]:
    """Start of each image's rows, then the end of the last one's.

    Raises:
        PocketGSError: the lists contain rows that do not exist, or images share rows.
    """
    firsts = [rows] * (len(offsets) + 1)
    ends = [0, *offsets.reshape(-1), len(given)]
    sound = np.all(np.diff(ends) >= 0) and (len(given) == 0 or 0 <= given.min() <= given.max() < rows)
    for image in reversed(range(len(offsets))):
        own = given[offsets[image, 0] : offsets[image, -1]] if sound else given[:0]
        firsts[image] = min(int(own.min(initial=rows)), firsts[image + 1]) if image else 0
        sound = sound and own.max(initial=-1) < firsts[image + 1]
    if not sound:
        raise PocketGSError(f"flatten_ids: found lists that do not belong to {len(offsets)} images of {rows} splats")
    return firsts


def _masked(offsets: np.ndarray, given: np.ndarray, masks: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The lists without those of masked tiles."""
    counts = np.diff(offsets, axis=1)
    kept = np.where(masks, counts, 0)
    shortened = np.zeros(kept.size + 1, np.int64)
    np.cumsum(kept.reshape(-1), out=shortened[1:])
    new = np.empty_like(offsets)
    new[:, :-1] = shortened[:-1].reshape(kept.shape)
    new[:, -1] = shortened[1:].reshape(kept.shape)[:, -1]
    return new, given[np.repeat(masks.reshape(-1), counts.reshape(-1))]
