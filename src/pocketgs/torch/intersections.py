"""Tile intersections in gsplat's layout, for callers that need them, and for `rasterize_to_pixels`."""

from __future__ import annotations

import math

import numpy as np
import torch
from torch import Tensor

from pocketgs.errors import PocketGSError
from pocketgs.splat.cpu.operators.given_lists import list_intersections
from pocketgs.torch.arrays import array_of, check_shape, check_tensors, whole_numbers

DEPTH_BITS = 32


def isect_tiles(
    means2d: Tensor,
    radii: Tensor,
    depths: Tensor,
    tile_size: int,
    tile_width: int,
    tile_height: int,
    sort: bool = True,
    segmented: bool = False,
    packed: bool = False,
    n_images: int | None = None,
    image_ids: Tensor | None = None,
    gaussian_ids: Tensor | None = None,
) -> tuple[Tensor, Tensor, Tensor]:
    """Find the tiles that the rectangles around splats touch.

    Args:
        means2d: (..., N, 2) centres in pixels; with `packed` (nnz, 2).
        radii: (..., N, 2) int32, half the rectangles' sides; 0 for invisible Gaussians.
        depths: (..., N).
        tile_size: side of a tile in pixels.
        tile_width: tiles in a row.
        tile_height: tiles in a column.
        sort: whether to sort by image, tile and depth.
        segmented: ignored: the result does not depend on how it is sorted.
        packed: whether only visible Gaussians have rows.
        n_images: number of images; with `packed`.
        image_ids: (nnz,) image of each row; with `packed`.
        gaussian_ids: ignored.

    Returns:
        Number of tiles that each splat touches, int32, of the shape of `depths`; intersections (E,) int64, each image |
        tile | bits of the depth; and their rows (E,) int32.

    Raises:
        PocketGSError: shapes disagree, a size is not a positive integer, or there is no such image.
    """
    tile_size, tile_width, tile_height = whole_numbers(
        1, tile_size=tile_size, tile_width=tile_width, tile_height=tile_height
    )
    check_tensors(1, means2d=means2d, radii=radii, depths=depths)
    shape = tuple(depths.shape)
    check_shape("means2d", means2d, (*shape, 2))
    check_shape("radii", radii, (*shape, 2))
    count = math.prod(shape[:-1])
    if packed:
        if n_images is None or image_ids is None:
            raise PocketGSError("isect_tiles: packed=True takes n_images and image_ids")
        check_tensors(1, image_ids=image_ids)
        check_shape("image_ids", image_ids, (math.prod(shape),))
        (count,), images = whole_numbers(0, n_images=n_images), array_of(image_ids).astype(np.int64)
        if len(images) and not 0 <= images.min() <= images.max() < count:
            raise PocketGSError(f"image_ids: found {images.min()} to {images.max()}, expected 0 to {count - 1}")
    else:
        images = np.repeat(np.arange(count, dtype=np.int64), shape[-1])
    centres, reach = (
        array_of(each).reshape(-1, 2).astype(np.float32) / np.float32(tile_size) for each in (means2d, radii)
    )
    most = np.array([tile_width, tile_height], np.float32)
    first = np.clip(np.floor(centres - reach), 0.0, most).astype(np.int64)
    end = np.clip(np.ceil(centres + reach), 0.0, most).astype(np.int64)
    end[~(reach > 0.0).all(axis=1)] = 0
    end = np.maximum(first, end)
    touched = np.prod(end - first, axis=1)
    tile_bits = (tile_width * tile_height).bit_length()
    if count.bit_length() + tile_bits + DEPTH_BITS > 64:
        raise PocketGSError(
            f"isect_tiles: found {count} images of {tile_width * tile_height} tiles, too many to number"
        )
    bits = array_of(depths).reshape(-1).astype(np.float32).view(np.uint32).astype(np.int64)
    ids, rows = np.empty(touched.sum(), np.int64), np.empty(touched.sum(), np.int32)
    list_intersections(first, end, images, bits, tile_width, tile_bits, ids, rows)
    if sort:
        order = np.argsort(ids, kind="stable")
        ids, rows = ids[order], rows[order]
    return torch.from_numpy(touched.astype(np.int32)).reshape(shape), torch.from_numpy(ids), torch.from_numpy(rows)


def isect_offset_encode(isect_ids: Tensor, n_images: int, tile_width: int, tile_height: int) -> Tensor:
    """Find the start of each tile's intersections.

    Args:
        isect_ids: (E,) int64 from `isect_tiles`, sorted.
        n_images: number of images.
        tile_width: tiles in a row.
        tile_height: tiles in a column.

    Returns:
        (I, tile_height, tile_width) int32.

    Raises:
        PocketGSError: a size is not a positive integer.
    """
    check_tensors(1, isect_ids=isect_ids)
    (n_images,) = whole_numbers(0, n_images=n_images)
    tile_width, tile_height = whole_numbers(1, tile_width=tile_width, tile_height=tile_height)
    tiles = tile_width * tile_height
    numbers = (np.arange(n_images, dtype=np.int64)[:, None] << tiles.bit_length()) | np.arange(tiles, dtype=np.int64)
    firsts = np.searchsorted(array_of(isect_ids) >> DEPTH_BITS, numbers.reshape(-1)).astype(np.int32)
    return torch.from_numpy(firsts).reshape(n_images, tile_height, tile_width)
