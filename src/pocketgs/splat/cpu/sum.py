"""Add up the splats of each tile, in any order: C = Σ c_i α_i + T · background, T = Π (1 - α_i).

No splat hides another and no pixel is ever full, so splats need not be sorted by depth. Here α_i is what exceeds
1/255, so that it is continuous where a splat's edge moves across a pixel.

The gradient needs no replay: ∂L/∂α_i = c_i · ∂L/∂C - T / (1 - α_i) ∂L/∂T depends only on the finished pixel's T.
"""

from __future__ import annotations

import numpy as np
from numba import prange

from pocketgs.splat.constants import ALPHA_MIN
from pocketgs.splat.cpu.bin import TileLists
from pocketgs.splat.cpu.lanes import LANES, Floats, broadcast, load, prefetch, select, store
from pocketgs.splat.cpu.layout import (
    COLOURS,
    FIRST_CHANNEL,
    INTERSECTION_ROWS,
    INTERSECTION_SLOT,
    INTERSECTION_SPLAT,
    TILE_PIXELS,
)
from pocketgs.splat.cpu.tile import (
    AHEAD,
    ONE,
    ZERO,
    alpha_at,
    column_offsets,
    exponent_terms,
    first_and_end_pixel,
    origin,
    row_offsets,
)
from pocketgs.splat.cpu.tile_image import TileImage, add_product, read_tile, write_over
from pocketgs.splat.cpu.tile_sums import (
    no_sums,
    summed_up,
    sums_per_intersection,
    take_gradient,
    with_pixels,
    with_pulls,
    write_sums,
)
from pocketgs.splat.limits import Limits
from pocketgs.system.compile import inlined, parallel_kernel
from pocketgs.system.dealing import first_piece, take

_WEIGHTED = COLOURS + 1
"""Weighted colours, and the weight: the channels of sort-free images, which the compiler unrolls."""

_CUT = np.float32(ALPHA_MIN)


@inlined
def _beyond_cut(alpha: Floats) -> Floats:
    return max(alpha - _CUT, broadcast(ZERO))


@inlined
def _add(
    splat: np.ndarray,
    rows: int,
    left: int,
    top: int,
    channels: int,
    most_opaque: float,
    transmittance: np.ndarray,
    totals: np.ndarray,
) -> None:
    terms = exponent_terms(splat, column_offsets(splat, left))
    first, end = first_and_end_pixel(rows)
    for pixel in range(first, end, LANES):
        _, drawn = alpha_at(terms, row_offsets(splat, top, pixel), broadcast(ONE), most_opaque)
        alpha = _beyond_cut(drawn)
        t = load(transmittance, pixel)
        store(transmittance, pixel, t - t * alpha)
        for channel in range(channels):
            place = channel * TILE_PIXELS + pixel
            store(totals, place, load(totals, place) + alpha * splat[FIRST_CHANNEL + channel])


@parallel_kernel
def add_up(
    splats: np.ndarray, lists: TileLists, background: np.ndarray, limits: Limits, threads: int, drawn: TileImage
) -> None:
    """Draw all tiles. Arguments as those of `rasterize`; of the limits, only `most_opaque` counts."""
    channels, height = drawn.image.shape[:2]
    counter = first_piece()
    for _ in prange(threads):
        transmittance, totals = np.empty(TILE_PIXELS, np.float32), np.empty(channels * TILE_PIXELS, np.float32)
        tile = take(counter)
        while tile < len(drawn.drawn_ends):
            left, top = origin(tile, height)
            transmittance[:], totals[:] = 1.0, 0.0
            end = lists.ranges[tile + 1]
            for index in range(lists.ranges[tile], end):
                intersection = lists.intersections[index]
                if index + AHEAD < end:
                    prefetch(splats, lists.intersections[index + AHEAD, INTERSECTION_SPLAT])
                splat, rows = splats[intersection[INTERSECTION_SPLAT]], intersection[INTERSECTION_ROWS]
                # A constant lets the compiler unroll the loop over channels.
                if channels == _WEIGHTED:
                    _add(splat, rows, left, top, _WEIGHTED, limits.most_opaque, transmittance, totals)
                else:
                    _add(splat, rows, left, top, channels, limits.most_opaque, transmittance, totals)
            write_over(tile, end, background, transmittance, totals, drawn)
            tile = take(counter)


@inlined
def _add_backward(
    splat: np.ndarray,
    rows: int,
    left: int,
    top: int,
    channels: int,
    absolute: bool,
    most_opaque: float,
    behind: np.ndarray,
    d_totals: np.ndarray,
    more_sums: np.ndarray,
) -> Floats:
    """One splat in one tile; returns the vector of its sums."""
    dx = column_offsets(splat, left)
    terms = exponent_terms(splat, dx)
    found, pulled = no_sums(channels, more_sums)
    first, end = first_and_end_pixel(rows)
    for pixel in range(first, end, LANES):
        dy = row_offsets(splat, top, pixel)
        unclamped, drawn = alpha_at(terms, dy, broadcast(ONE), most_opaque)
        alpha = _beyond_cut(drawn)
        d_colour, product = take_gradient(splat, pixel, channels, alpha, d_totals, more_sums)
        # ∂L/∂(ln drawn) = drawn ∂L/∂α; 0 where it is clamped.
        v = drawn * (product - load(behind, pixel) / (ONE - alpha))
        v = select(unclamped < broadcast(most_opaque), v, broadcast(ZERO))
        found = with_pixels(found, dy, v, alpha, d_colour)
        if absolute:
            pulled = with_pulls(pulled, splat, dx, dy, v)
    return summed_up(dx, found, absolute, pulled)


@parallel_kernel
def add_up_backward(
    splats: np.ndarray,
    lists: TileLists,
    limits: Limits,
    threads: int,
    drawn: TileImage,
    d_image: np.ndarray,
    d_transmittance: np.ndarray,
    absolute: bool,
    intersection_sums: np.ndarray,
) -> None:
    """Differentiate all tiles. Arguments as those of `rasterize_backward`, for an image over a background of 0."""
    channels, height = drawn.image.shape[:2]
    row = sums_per_intersection(channels)
    counter = first_piece()
    for _ in prange(threads):
        behind = np.empty(TILE_PIXELS, np.float32)
        d_totals = np.empty(channels * TILE_PIXELS, np.float32)
        more_sums = np.empty((channels - COLOURS) * LANES, np.float32)
        tile = take(counter)
        while tile < len(drawn.drawn_ends):
            left, top = origin(tile, height)
            behind[:] = 0.0
            for channel in range(channels):
                read_tile(d_image[channel], left, top, d_totals[channel * TILE_PIXELS : (channel + 1) * TILE_PIXELS])
            if d_transmittance.size:
                add_product(drawn.transmittance, d_transmittance, left, top, behind)
            end = lists.ranges[tile + 1]
            for index in range(lists.ranges[tile], end):
                intersection = lists.intersections[index]
                if index + AHEAD < end:
                    prefetch(splats, lists.intersections[index + AHEAD, INTERSECTION_SPLAT])
                splat, rows = splats[intersection[INTERSECTION_SPLAT]], intersection[INTERSECTION_ROWS]
                first, most_opaque = intersection[INTERSECTION_SLOT] * row, limits.most_opaque
                # Constants let the compiler remove unused branches.
                if channels == _WEIGHTED and not absolute:
                    total = _add_backward(
                        splat, rows, left, top, _WEIGHTED, False, most_opaque, behind, d_totals, more_sums
                    )
                else:
                    total = _add_backward(
                        splat, rows, left, top, channels, absolute, most_opaque, behind, d_totals, more_sums
                    )
                write_sums(intersection_sums, first, total, channels, more_sums)
            tile = take(counter)
