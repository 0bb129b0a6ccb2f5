"""Add up the splats of every tile, in whatever order they are listed: C = Σ c_i α_i + T · background, T = Π (1 - α_i).

No splat hides another and no pixel is ever full, so nothing has to be sorted by depth. α_i counts from the cut of 1/255
on, so that a splat comes into a pixel little by little: nothing that is in front of it takes it back.

The gradient needs no replay in order either: ∂L/∂α_i = c_i · ∂L/∂C - T / (1 - α_i) ∂L/∂T takes the finished pixel's T
alone.
"""

from __future__ import annotations

import numpy as np
from numba import prange

from pocketgs.splat.constants import ALPHA_MIN
from pocketgs.splat.cpu.lanes import LANES, Floats, broadcast, load, prefetch, select, store
from pocketgs.splat.cpu.layout import (
    COLOURS,
    FIRST_CHANNEL,
    INTERSECTION_ROWS,
    INTERSECTION_SLOT,
    INTERSECTION_SPLAT,
    TILE_PIXELS,
)
from pocketgs.splat.cpu.rasterize import AHEAD, write_over
from pocketgs.splat.cpu.rasterize_backward import (
    add_product,
    pulls,
    read_tile,
    summed_up,
    sums_per_intersection,
    take_gradient,
    write_sums,
)
from pocketgs.splat.cpu.tile import (
    ONE,
    ZERO,
    alpha_at,
    column_offsets,
    exponent_terms,
    first_and_end_pixel,
    origin,
    row_offsets,
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
    splats: np.ndarray,
    intersections: np.ndarray,
    ranges: np.ndarray,
    background: np.ndarray,
    limits: Limits,
    threads: int,
    image: np.ndarray,
    transmittance_image: np.ndarray,
    drawn_ends: np.ndarray,
) -> None:
    """Draw every tile. Arguments as `rasterize` has them; of the limits, only `most_opaque` counts."""
    channels, height = image.shape[:2]
    counter = first_piece()
    for _ in prange(threads):
        transmittance, totals = np.empty(TILE_PIXELS, np.float32), np.empty(channels * TILE_PIXELS, np.float32)
        tile = take(counter)
        while tile < len(drawn_ends):
            left, top = origin(tile, height)
            transmittance[:], totals[:] = 1.0, 0.0
            for index in range(ranges[tile], ranges[tile + 1]):
                intersection = intersections[index]
                if index + AHEAD < ranges[tile + 1]:
                    prefetch(splats, intersections[index + AHEAD, INTERSECTION_SPLAT])
                splat, rows = splats[intersection[INTERSECTION_SPLAT]], intersection[INTERSECTION_ROWS]
                if channels == _WEIGHTED:
                    _add(splat, rows, left, top, _WEIGHTED, limits.most_opaque, transmittance, totals)
                else:
                    _add(splat, rows, left, top, channels, limits.most_opaque, transmittance, totals)
            drawn_ends[tile] = ranges[tile + 1]
            write_over(background, left, top, transmittance, totals, transmittance_image, image)
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
    """One splat in one tile; returns the vector of its sums, see `rasterize_backward`."""
    dx = column_offsets(splat, left)
    terms = exponent_terms(splat, dx)
    v_sum = vy_sum = vyy_sum = red_sum = green_sum = blue_sum = absolute_x = absolute_y = broadcast(ZERO)
    for channel in range(COLOURS, channels):
        store(more_sums, (channel - COLOURS) * LANES, broadcast(ZERO))
    first, end = first_and_end_pixel(rows)
    for pixel in range(first, end, LANES):
        dy = row_offsets(splat, top, pixel)
        unclamped, drawn = alpha_at(terms, dy, broadcast(ONE), most_opaque)
        alpha = _beyond_cut(drawn)
        r, g, b, product = take_gradient(splat, pixel, channels, alpha, d_totals, more_sums)
        # By the logarithm of what is drawn, which is more by the cut; it is flat where it is clamped.
        v = drawn * (product - load(behind, pixel) / (ONE - alpha))
        v = select(unclamped < broadcast(most_opaque), v, broadcast(ZERO))
        vy = v * dy
        v_sum, vy_sum, vyy_sum = v_sum + v, vy_sum + vy, vyy_sum + vy * dy
        red_sum, green_sum, blue_sum = red_sum + alpha * r, green_sum + alpha * g, blue_sum + alpha * b
        if absolute:
            pull_x, pull_y = pulls(splat, dx, dy, v)
            absolute_x, absolute_y = absolute_x + pull_x, absolute_y + pull_y
    colours = (red_sum, green_sum, blue_sum)
    return summed_up(dx, (v_sum, vy_sum, vyy_sum), colours, absolute, (absolute_x, absolute_y))


@parallel_kernel
def add_up_backward(
    splats: np.ndarray,
    intersections: np.ndarray,
    ranges: np.ndarray,
    drawn_ends: np.ndarray,
    limits: Limits,
    threads: int,
    image: np.ndarray,
    d_image: np.ndarray,
    transmittance_image: np.ndarray,
    d_transmittance: np.ndarray,
    absolute: bool,
    intersection_sums: np.ndarray,
) -> None:
    """Go through every tile. Arguments as `rasterize_backward` has them, for an image over a background of 0."""
    channels, height = image.shape[:2]
    row = sums_per_intersection(channels)
    counter = first_piece()
    for _ in prange(threads):
        behind = np.empty(TILE_PIXELS, np.float32)
        d_totals = np.empty(channels * TILE_PIXELS, np.float32)
        more_sums = np.empty((channels - COLOURS) * LANES, np.float32)
        tile = take(counter)
        while tile < len(drawn_ends):
            left, top = origin(tile, height)
            behind[:] = 0.0
            for channel in range(channels):
                read_tile(d_image[channel], left, top, d_totals[channel * TILE_PIXELS : (channel + 1) * TILE_PIXELS])
            if d_transmittance.size:
                add_product(transmittance_image, d_transmittance, left, top, behind)
            for index in range(ranges[tile], ranges[tile + 1]):
                intersection = intersections[index]
                if index + AHEAD < ranges[tile + 1]:
                    prefetch(splats, intersections[index + AHEAD, INTERSECTION_SPLAT])
                splat, rows = splats[intersection[INTERSECTION_SPLAT]], intersection[INTERSECTION_ROWS]
                first, most_opaque = intersection[INTERSECTION_SLOT] * row, limits.most_opaque
                # With constants the compiler leaves out the rest.
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
