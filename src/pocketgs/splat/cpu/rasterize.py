"""Composite the splats of each tile front to back: C = Σ c_i α_i T_i + T · background, for any number of channels."""

from __future__ import annotations

import numpy as np
from numba import prange

from pocketgs.splat.cpu.lanes import LANES, broadcast, load, prefetch, select, store
from pocketgs.splat.cpu.layout import (
    FIRST_CHANNEL,
    INTERSECTION_ROWS,
    INTERSECTION_SPLAT,
    TILE_HEIGHT,
    TILE_PIXELS,
    TILE_WIDTH,
)
from pocketgs.splat.cpu.tile import (
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
from pocketgs.splat.limits import Limits
from pocketgs.system.compile import inlined, parallel_kernel, part
from pocketgs.system.dealing import first_piece, take

AHEAD = 4
"""Number of intersections to prefetch ahead."""

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


@part
def write_tile(tile_pixels: np.ndarray, left: int, top: int, image: np.ndarray) -> None:
    """Copy the part of a tile inside the image to it."""
    for row in range(min(TILE_HEIGHT, image.shape[0] - top)):
        for column in range(min(TILE_WIDTH, image.shape[1] - left)):
            image[top + row, left + column] = tile_pixels[row * TILE_WIDTH + column]


@part
def write_over(
    background: np.ndarray,
    left: int,
    top: int,
    transmittance: np.ndarray,
    colours: np.ndarray,
    transmittance_image: np.ndarray,
    image: np.ndarray,
) -> None:
    """Copy a tile to the images of transmittance and channels, blended over the background."""
    write_tile(transmittance, left, top, transmittance_image)
    for channel in range(image.shape[0]):
        plane = colours[channel * TILE_PIXELS : (channel + 1) * TILE_PIXELS]
        for pixel in range(TILE_PIXELS):
            plane[pixel] += transmittance[pixel] * background[channel]
        write_tile(plane, left, top, image[channel])


@parallel_kernel
def rasterize(
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
    """Draw all tiles.

    Args:
        splats: (N, FIRST_CHANNEL + C) from `project`.
        intersections: (E, INTERSECTION_FIELDS) int32, the tile lists; see `TileLists`.
        ranges: (tiles + 1,) int32, start of each tile's intersections.
        background: (C,) float32.
        limits: of compositing.
        threads: number of threads.
        image: (C, H, W) float32, written.
        transmittance_image: (H, W) float32, written.
        drawn_ends: (tiles,) int32, written: one past the last intersection drawn before the tile saturated.
    """
    channels, height = image.shape[:2]
    counter = first_piece()
    for _ in prange(threads):
        transmittance, colours = np.empty(TILE_PIXELS, np.float32), np.empty(channels * TILE_PIXELS, np.float32)
        tile = take(counter)
        while tile < len(drawn_ends):
            left, top = origin(tile, height)
            transmittance[:], colours[:] = 1.0, 0.0
            end = ranges[tile + 1]
            for index in range(ranges[tile], ranges[tile + 1]):
                intersection = intersections[index]
                if index + AHEAD < ranges[tile + 1]:
                    prefetch(splats, intersections[index + AHEAD, INTERSECTION_SPLAT])
                splat, rows = splats[intersection[INTERSECTION_SPLAT]], intersection[INTERSECTION_ROWS]
                # A constant lets the compiler remove unused branches.
                if limits.stops_before:
                    _draw(splat, rows, left, top, channels, limits.most_opaque, True, transmittance, colours)
                else:
                    _draw(splat, rows, left, top, channels, limits.most_opaque, False, transmittance, colours)
                if index % INTERSECTIONS_PER_CHECK == 0 and is_saturated(transmittance):
                    end = index + 1
                    break
            drawn_ends[tile] = end
            if limits.stops_before:
                forget_full_pixels(transmittance)
            write_over(background, left, top, transmittance, colours, transmittance_image, image)
            tile = take(counter)
