"""Composite the splats of every tile front to back: C = Σ c_i α_i T_i + T · background."""

from __future__ import annotations

import numpy as np
from numba import prange

from pocketgs.splat.cpu.lanes import LANES, load, store
from pocketgs.splat.cpu.layout import (
    BLUE,
    ENTRY_ROWS,
    ENTRY_SPLAT,
    GREEN,
    RED,
    TILE_HEIGHT,
    TILE_PIXELS,
    TILE_WIDTH,
)
from pocketgs.splat.cpu.tile import (
    alpha_at,
    column_offsets,
    exponent_terms,
    first_and_end_pixel,
    is_saturated,
    origin,
    row_offsets,
)
from pocketgs.system.compile import inlined, parallel_kernel, part
from pocketgs.system.dealing import first_piece, take

# Asking whether a whole tile is saturated costs about as much as drawing one splat.
ENTRIES_PER_CHECK = 16


@inlined
def _draw(
    splat: np.ndarray,
    rows: int,
    left: int,
    top: int,
    transmittance: np.ndarray,
    red: np.ndarray,
    green: np.ndarray,
    blue: np.ndarray,
) -> None:
    dx = column_offsets(splat, left)
    terms = exponent_terms(splat, dx)
    first, end = first_and_end_pixel(rows)
    for pixel in range(first, end, LANES):
        t = load(transmittance, pixel)
        _, alpha = alpha_at(terms, row_offsets(splat, top, pixel), t)
        weight = alpha * t
        store(transmittance, pixel, t - weight)
        store(red, pixel, load(red, pixel) + weight * splat[RED])
        store(green, pixel, load(green, pixel) + weight * splat[GREEN])
        store(blue, pixel, load(blue, pixel) + weight * splat[BLUE])


@part
def _write(tile_pixels: np.ndarray, left: int, top: int, image: np.ndarray) -> None:
    """Copy the part of a tile that lies inside the image to it."""
    for row in range(min(TILE_HEIGHT, image.shape[0] - top)):
        for column in range(min(TILE_WIDTH, image.shape[1] - left)):
            image[top + row, left + column] = tile_pixels[row * TILE_WIDTH + column]


@parallel_kernel
def rasterize(
    splats: np.ndarray,
    entries: np.ndarray,
    ranges: np.ndarray,
    background: np.ndarray,
    threads: int,
    image: np.ndarray,
    transmittance_image: np.ndarray,
    drawn_ends: np.ndarray,
) -> None:
    """Draw every tile.

    Args:
        splats: (N, SPLAT_FIELDS) from `project`.
        entries: (E, ENTRY_FIELDS) int32, the tiles' lists; see `TileLists`.
        ranges: (tiles + 1,) int32, where each tile's entries begin.
        background: (3,) float32 RGB.
        threads: number of threads that draw.
        image: (3, H, W) float32, written.
        transmittance_image: (H, W) float32, written.
        drawn_ends: (tiles,) int32, written: one past the last entry drawn before the tile saturated.
    """
    height = image.shape[1]
    counter = first_piece()
    for _ in prange(threads):
        transmittance = np.empty(TILE_PIXELS, np.float32)
        red = np.empty(TILE_PIXELS, np.float32)
        green = np.empty(TILE_PIXELS, np.float32)
        blue = np.empty(TILE_PIXELS, np.float32)
        tile = take(counter)
        while tile < len(drawn_ends):
            left, top = origin(tile, height)
            transmittance[:], red[:], green[:], blue[:] = 1.0, 0.0, 0.0, 0.0
            end = ranges[tile + 1]
            for index in range(ranges[tile], ranges[tile + 1]):
                entry = entries[index]
                splat = splats[entry[ENTRY_SPLAT]]
                _draw(splat, entry[ENTRY_ROWS], left, top, transmittance, red, green, blue)
                if index % ENTRIES_PER_CHECK == 0 and is_saturated(transmittance):
                    end = index + 1
                    break
            drawn_ends[tile] = end
            for pixel in range(TILE_PIXELS):
                red[pixel] += transmittance[pixel] * background[0]
                green[pixel] += transmittance[pixel] * background[1]
                blue[pixel] += transmittance[pixel] * background[2]
            _write(transmittance, left, top, transmittance_image)
            _write(red, left, top, image[0])
            _write(green, left, top, image[1])
            _write(blue, left, top, image[2])
            tile = take(counter)
