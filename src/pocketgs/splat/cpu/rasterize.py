"""Composite the splats of each tile front to back: C = Σ c_i α_i T_i + T · background, for any number of channels."""

from __future__ import annotations

import numpy as np
from numba import prange

from pocketgs.splat.cpu.bin import TileLists
from pocketgs.splat.cpu.lanes import LANES, broadcast, load, prefetch, select, store
from pocketgs.splat.cpu.layout import FIRST_CHANNEL, INTERSECTION_ROWS, INTERSECTION_SPLAT, TILE_PIXELS
from pocketgs.splat.cpu.tile import (
    AHEAD,
    ZERO,
    alpha_at,
    column_offsets,
    exponent_terms,
    fills,
    first_and_end_pixel,
    forget_full_pixels,
    is_saturated,
    origin,
    row_offsets,
)
from pocketgs.splat.cpu.tile_image import TileImage, write_over
from pocketgs.splat.limits import Limits
from pocketgs.system.compile import inlined, parallel_kernel
from pocketgs.system.dealing import first_piece, take

# Testing a whole tile for saturation costs about as much as drawing one splat.
INTERSECTIONS_PER_CHECK = 16


@inlined
def _draw(
    splat: np.ndarray,
    rows: int,
    left: int,
    top: int,
    channels: int,
    most_opaque: float,
    stops_before: bool,
    transmittance: np.ndarray,
    colours: np.ndarray,
) -> None:
    dx = column_offsets(splat, left)
    terms = exponent_terms(splat, dx)
    first, end = first_and_end_pixel(rows)
    for pixel in range(first, end, LANES):
        t = load(transmittance, pixel)
        _, alpha = alpha_at(terms, row_offsets(splat, top, pixel), t, most_opaque)
        weight = alpha * t
        rest = t - weight
        if stops_before:
            full, rest = fills(t, rest)
            weight = select(full, broadcast(ZERO), weight)
        store(transmittance, pixel, rest)
        for channel in range(channels):
            place = channel * TILE_PIXELS + pixel
            store(colours, place, load(colours, place) + weight * splat[FIRST_CHANNEL + channel])


@parallel_kernel
def rasterize(
    splats: np.ndarray, lists: TileLists, background: np.ndarray, limits: Limits, threads: int, drawn: TileImage
) -> None:
    """Draw all tiles.

    Args:
        splats: (N, FIRST_CHANNEL + C) from `project`.
        lists: of the image.
        background: (C,) float32.
        limits: of compositing.
        threads: number of threads.
        drawn: written.
    """
    channels, height = drawn.image.shape[:2]
    counter = first_piece()
    for _ in prange(threads):
        transmittance, colours = np.empty(TILE_PIXELS, np.float32), np.empty(channels * TILE_PIXELS, np.float32)
        tile = take(counter)
        while tile < len(drawn.drawn_ends):
            left, top = origin(tile, height)
            transmittance[:], colours[:] = 1.0, 0.0
            first = lists.ranges[tile]
            end = listed = lists.ranges[tile + 1]
            for index in range(first, listed):
                intersection = lists.intersections[index]
                if index + AHEAD < listed:
                    prefetch(splats, lists.intersections[index + AHEAD, INTERSECTION_SPLAT])
                splat, rows = splats[intersection[INTERSECTION_SPLAT]], intersection[INTERSECTION_ROWS]
                # A constant lets the compiler remove unused branches.
                if limits.stops_before:
                    _draw(splat, rows, left, top, channels, limits.most_opaque, True, transmittance, colours)
                else:
                    _draw(splat, rows, left, top, channels, limits.most_opaque, False, transmittance, colours)
                if index % INTERSECTIONS_PER_CHECK == 0 and is_saturated(transmittance):
                    end = index + 1
                    break
            if limits.stops_before:
                forget_full_pixels(transmittance)
            write_over(tile, end, background, transmittance, colours, drawn)
            tile = take(counter)
