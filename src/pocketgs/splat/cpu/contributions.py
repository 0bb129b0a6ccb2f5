"""Contributions of each Gaussian to an image, and the median depth."""

from __future__ import annotations

import numpy as np
from numba import prange

from pocketgs.splat.cpu.bin import TileLists
from pocketgs.splat.cpu.lanes import LANES, Floats, broadcast, load, select, store, sums
from pocketgs.splat.cpu.layout import (
    DEPTH,
    INTERSECTION_ROWS,
    INTERSECTION_SLOT,
    INTERSECTION_SPLAT,
    SLOTS_COUNT,
    SLOTS_FIRST,
    TILE_PIXELS,
)
from pocketgs.splat.cpu.tile import (
    ONE,
    ZERO,
    alpha_at,
    column_offsets,
    exponent_terms,
    first_and_end_pixel,
    origin,
    pixels_inside,
    row_offsets,
)
from pocketgs.splat.cpu.tile_image import TileImage, write_tile
from pocketgs.splat.limits import TRAINING
from pocketgs.system.compile import inlined, kernel, parallel_kernel
from pocketgs.system.dealing import first_piece, take

PIXELS, SUMMED, LARGEST = range(3)
"""Columns of contributions."""

_HALF = np.float32(0.5)


@inlined
def _inspect(
    splat: np.ndarray,
    rows: int,
    left: int,
    top: int,
    inside: np.ndarray,
    transmittance: np.ndarray,
    median: np.ndarray,
    intersection: np.ndarray,
) -> None:
    """Process one splat in one tile without its colour, and write its contributions there."""
    dx = column_offsets(splat, left)
    terms = exponent_terms(splat, dx)
    zero, one = broadcast(ZERO), broadcast(ONE)
    pixels = summed = largest = zero
    first, end = first_and_end_pixel(rows)
    for pixel in range(first, end, LANES):
        t = load(transmittance, pixel)
        _, alpha = alpha_at(terms, row_offsets(splat, top, pixel), t, TRAINING.most_opaque)
        weight = alpha * t
        rest = t - weight
        store(transmittance, pixel, rest)
        crosses = (t >= broadcast(_HALF)) & (rest < broadcast(_HALF))
        store(median, pixel, select(crosses, broadcast(splat[DEPTH]), load(median, pixel)))
        weight = weight * load(inside, pixel)
        pixels, summed = pixels + select(zero < weight, one, zero), summed + weight
        largest = max(largest, weight)
    _write(sums((pixels, summed)), largest, intersection)


@inlined
def _write(totals: Floats, largest: Floats, intersection: np.ndarray) -> None:
    lanes = np.empty(LANES, np.float32)
    store(lanes, 0, totals)
    intersection[PIXELS], intersection[SUMMED] = lanes[0], lanes[1]
    store(lanes, 0, largest)
    intersection[LARGEST] = lanes.max()


@parallel_kernel
def inspect(
    splats: np.ndarray,
    lists: TileLists,
    drawn: TileImage,
    threads: int,
    by_intersection: np.ndarray,
    median_image: np.ndarray,
) -> None:
    """Compute contributions and median depth of all tiles, in the order of `rasterize`.

    Args:
        splats: (N, FIRST_CHANNEL + C) from `project`.
        lists: of the image.
        drawn: the image from `rasterize`.
        threads: number of threads.
        by_intersection: (E, 3) float32, all 0; written at each intersection's slot.
        median_image: (H, W) float32, written: depth of the splat that brings the transmittance below one half, or 0.
    """
    height, width = median_image.shape
    counter = first_piece()
    for _ in prange(threads):
        transmittance, median = np.empty(TILE_PIXELS, np.float32), np.empty(TILE_PIXELS, np.float32)
        inside = np.empty(TILE_PIXELS, np.float32)
        tile = take(counter)
        while tile < len(drawn.drawn_ends):
            left, top = origin(tile, height)
            pixels_inside(left, top, width, height, inside)
            transmittance[:], median[:] = 1.0, 0.0
            for index in range(lists.ranges[tile], drawn.drawn_ends[tile]):
                intersection = lists.intersections[index]
                own = by_intersection[intersection[INTERSECTION_SLOT]]
                splat = splats[intersection[INTERSECTION_SPLAT]]
                _inspect(splat, intersection[INTERSECTION_ROWS], left, top, inside, transmittance, median, own)
            write_tile(median, left, top, median_image)
            tile = take(counter)


@kernel
def gather_contributions(
    visible: np.ndarray, slots: np.ndarray, by_intersection: np.ndarray, by_splat: np.ndarray
) -> None:
    """Reduce the contributions of each Gaussian's intersections, in the order of their slots.

    Args:
        visible: (V,) int32 indices of the Gaussians that are drawn.
        slots: (N, 2) int32 of `TileLists`.
        by_intersection: (E, 3) float32 from `inspect`.
        by_splat: (N, 3) float32, all 0; written where visible.
    """
    for i in visible:
        own = by_splat[i]
        for slot in range(slots[i, SLOTS_FIRST], slots[i, SLOTS_FIRST] + slots[i, SLOTS_COUNT]):
            own[PIXELS] += by_intersection[slot, PIXELS]
            own[SUMMED] += by_intersection[slot, SUMMED]
            own[LARGEST] = max(own[LARGEST], by_intersection[slot, LARGEST])
