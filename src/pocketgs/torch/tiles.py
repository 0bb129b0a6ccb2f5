"""Tile lists of images: computed here, or given in gsplat's layout."""

from __future__ import annotations

import threading
import weakref
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import torch
from torch import Tensor

from pocketgs.splat.constants import CULLED
from pocketgs.splat.cpu.bin import Binner, TileLists
from pocketgs.splat.cpu.layout import CLUSTER, COLOURS, FIRST_CHANNEL, View
from pocketgs.splat.cpu.operators.given_lists import lists_from
from pocketgs.splat.cpu.operators.splat_rows import write_rows
from pocketgs.splat.cpu.sort import sort_by_depth
from pocketgs.torch.arrays import array_of, flat, torch_threads, whole_numbers

NO_COLOURS = np.empty((0, 0), np.float32)
_NO_DEPTHS = np.empty(0, np.float32)

MAX_KEPT = 8
"""Maximum number of binners kept for later images: fresh memory costs a page fault every 4 KB."""

_waiting: list[tuple[int, Binner]] = []

# Reentrant: while a thread takes a binner, its garbage collector may delete lists, which gives others back.
_pool = threading.RLock()


@dataclass(frozen=True)
class Tiles:
    """The tile lists of some images.

    Attributes:
        width, height: of every image.
        first_rows: (I + 1) start of each image's splats among all rows, then the end of the last one's.
        lists: of each image; splats are counted from the image's first row.
        visible: (V,) int32 for each image, splats that are drawn.
    """

    width: int
    height: int
    first_rows: Sequence[int]
    lists: Sequence[TileLists]
    visible: Sequence[np.ndarray]


class TileBinner(torch.autograd.Function):
    """`TileBinner.apply(centres, conics, opacities, depths, first_rows, width, height)` returns `Tiles`.

    Arguments are those of a `ProjectedSplats`, float32, of all images in turn. The result has no gradient.
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
        """Sort each image's splats by depth, and list them for the tiles that they reach."""
        threads, (width, height) = torch_threads(), whole_numbers(1, width=width, height=height)
        arrays = [flat(centres, 2), flat(conics, 3), *(array_of(each).reshape(-1) for each in (opacities, depths))]
        lists, visible = [], []
        for first, end in pairwise(first_rows):
            splats, keys = splat_rows([array[first:end] for array in arrays], NO_COLOURS, threads)
            clusters = np.arange(-(-len(keys) // CLUSTER), dtype=np.int32)
            seen, order = sort_by_depth(keys, clusters, *np.empty((3, len(keys)), np.int32))
            binner = _take_binner(threads)
            found = binner.bin(splats, seen, order, _image(width, height))
            # The rasterizer keeps both until backward, but hooks of saved tensors may keep a copy of either. So only
            # one of them is the binner's memory, which goes back with it.
            lists.append(found._replace(slots=found.slots[: len(keys)].copy()))
            visible.append(seen)
            weakref.finalize(found.intersections, _give_back, threads, binner).atexit = False
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
        splats: centres, conics and opacities, as for `TileBinner`.
        first_rows: start of each image's splats.
        offsets: (I, tiles + 1) int32, start of each tile's list in `given`, then the end of the image's last one.
        given: int32 rows of splats.
        tile_size: side of gsplat's tiles, a multiple of 16.
        size: width and height of every image.
    """
    threads = torch_threads()
    centres, conics, opacities = splats
    arrays: list[np.ndarray] = [flat(centres, 2), flat(conics, 3), array_of(opacities).reshape(-1)]
    lists, visible = [], []
    for image, (first, end) in enumerate(pairwise(first_rows)):
        rows, keys = splat_rows([array[first:end] for array in arrays], NO_COLOURS, threads)
        bounds = offsets[image]
        own = given[bounds[0] : bounds[-1]] - np.int32(first)
        lists.append(lists_from(rows, keys, bounds - bounds[0], own, tile_size, size, threads))
        visible.append(np.flatnonzero(keys != CULLED).astype(np.int32))
    return Tiles(*size, first_rows, lists, visible)


def _take_binner(threads: int) -> Binner:
    """An unused binner."""
    with _pool:
        for place, (own_threads, binner) in enumerate(_waiting):
            if own_threads == threads:
                del _waiting[place]
                return binner
    return Binner(threads)


def _give_back(threads: int, binner: Binner) -> None:
    """Return the binner of deleted lists for later images."""
    with _pool:
        if len(_waiting) < MAX_KEPT:
            _waiting.append((threads, binner))


def splat_rows(arrays: Sequence[np.ndarray], colours: np.ndarray, threads: int) -> tuple[np.ndarray, np.ndarray]:
    """The splats' rows and depth keys for kernels, from centres, conics, opacities and optionally depths."""
    centres, conics, opacities = arrays[:3]
    depths = arrays[3] if len(arrays) > 3 else _NO_DEPTHS
    splats = np.empty((len(centres), FIRST_CHANNEL + max(COLOURS, colours.shape[1])), np.float32)
    keys = np.empty(len(centres), np.uint32)
    write_rows(centres, conics, opacities, depths, colours, threads, splats, keys)
    return splats, keys


def _image(width: int, height: int) -> View:
    """A view that only defines an image size."""
    return View(np.eye(3), np.zeros(3), np.zeros(3), 1.0, 1.0, 0.0, 0.0, width, height, False)
