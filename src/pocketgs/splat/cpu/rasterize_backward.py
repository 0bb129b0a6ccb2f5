"""The gradient of the image by replaying each tile front to back.

The paper caches {C_in, α} of every contribution. Here nothing is cached: with D_i = c_i · ∂L/∂C, what lies behind
splat i enters its gradient only through the number H_i = Σ_{j>i} w_j D_j + T·background·∂L/∂C, which starts at
C · ∂L/∂C and loses w_i D_i at every contribution. Recomputing α takes some twenty instructions a vector, and no memory.
"""

from __future__ import annotations

import numpy as np
from numba import prange

from pocketgs.splat.cpu.lanes import LANES, Floats, broadcast, load, select, store, sums
from pocketgs.splat.cpu.layout import (
    BLUE,
    ENTRY_ROWS,
    ENTRY_SLOT,
    ENTRY_SPLAT,
    GREEN,
    RED,
    TILE_HEIGHT,
    TILE_PIXELS,
    TILE_WIDTH,
)
from pocketgs.splat.cpu.tile import (
    MOST_OPAQUE,
    ONE,
    ZERO,
    alpha_at,
    column_offsets,
    exponent_terms,
    first_and_end_pixel,
    origin,
    row_offsets,
)
from pocketgs.system.compile import inlined, parallel_kernel, part
from pocketgs.system.dealing import first_piece, take

# What a splat's replay in one tile leaves behind: sums over pixels of v = ∂L/∂(ln α) times 1, dx, dy, dx², dx dy, dy²,
# and the gradient of its colour.
SUM_EXPONENT, SUM_X, SUM_Y, SUM_XX, SUM_XY, SUM_YY, SUM_RED, SUM_GREEN, SUM_BLUE = range(9)


@inlined
def _replay(
    splat: np.ndarray,
    rows: int,
    left: int,
    top: int,
    transmittance: np.ndarray,
    behind: np.ndarray,
    d_red: np.ndarray,
    d_green: np.ndarray,
    d_blue: np.ndarray,
) -> Floats:
    """One splat in one tile; returns the vector of its sums."""
    dx = column_offsets(splat, left)
    terms = exponent_terms(splat, dx)
    v_sum = vy_sum = vyy_sum = red_sum = green_sum = blue_sum = broadcast(ZERO)
    first, end = first_and_end_pixel(rows)
    for pixel in range(first, end, LANES):
        t = load(transmittance, pixel)
        dy = row_offsets(splat, top, pixel)
        unclamped, alpha = alpha_at(terms, dy, t)
        weight = alpha * t
        store(transmittance, pixel, t - weight)
        r, g, b = load(d_red, pixel), load(d_green, pixel), load(d_blue, pixel)
        gain = weight * (r * splat[RED] + g * splat[GREEN] + b * splat[BLUE])
        rest = load(behind, pixel) - gain
        store(behind, pixel, rest)
        # ∂L/∂(ln α) = α ∂L/∂α = α (T D - H / (1 - α)); α is flat where it is clamped.
        v = gain - rest * (alpha / (ONE - alpha))
        v = select(unclamped < broadcast(MOST_OPAQUE), v, broadcast(ZERO))
        vy = v * dy
        v_sum, vy_sum, vyy_sum = v_sum + v, vy_sum + vy, vyy_sum + vy * dy
        red_sum, green_sum, blue_sum = red_sum + weight * r, green_sum + weight * g, blue_sum + weight * b
    # dx is the same in every row, so its powers multiply once.
    vx_sum = v_sum * dx
    return sums((v_sum, vx_sum, vy_sum, vx_sum * dx, vy_sum * dx, vyy_sum, red_sum, green_sum, blue_sum))


@part
def _read(image: np.ndarray, left: int, top: int, tile_pixels: np.ndarray) -> None:
    """Copy the part of an image that a tile covers; the rest of the tile is 0."""
    tile_pixels[:] = 0.0
    for row in range(min(TILE_HEIGHT, image.shape[0] - top)):
        for column in range(min(TILE_WIDTH, image.shape[1] - left)):
            tile_pixels[row * TILE_WIDTH + column] = image[top + row, left + column]


@part
def _add_product(image: np.ndarray, d_image: np.ndarray, left: int, top: int, tile_pixels: np.ndarray) -> None:
    """Add an image times its gradient to a tile."""
    for row in range(min(TILE_HEIGHT, image.shape[0] - top)):
        for column in range(min(TILE_WIDTH, image.shape[1] - left)):
            product = image[top + row, left + column] * d_image[top + row, left + column]
            tile_pixels[row * TILE_WIDTH + column] += product


@parallel_kernel
def rasterize_backward(
    splats: np.ndarray,
    entries: np.ndarray,
    ranges: np.ndarray,
    drawn_ends: np.ndarray,
    threads: int,
    image: np.ndarray,
    d_image: np.ndarray,
    entry_sums: np.ndarray,
) -> None:
    """Replay every tile.

    Args:
        splats: (N, SPLAT_FIELDS) from `project`.
        entries: (E, ENTRY_FIELDS) int32, the tiles' lists; see `TileLists`.
        ranges: (tiles + 1,) int32, where each tile's entries begin.
        drawn_ends: (tiles,) int32 that `rasterize` wrote.
        threads: number of threads that replay.
        image: (3, H, W) float32 that `rasterize` wrote.
        d_image: (3, H, W) float32 gradient with respect to `image`.
        entry_sums: (entries · LANES,) float32, written: a row of LANES for each entry, the sums first, at its slot.
    """
    height = image.shape[1]
    counter = first_piece()
    for _ in prange(threads):
        transmittance = np.empty(TILE_PIXELS, np.float32)
        behind = np.empty(TILE_PIXELS, np.float32)
        d_red = np.empty(TILE_PIXELS, np.float32)
        d_green = np.empty(TILE_PIXELS, np.float32)
        d_blue = np.empty(TILE_PIXELS, np.float32)
        tile = take(counter)
        while tile < len(drawn_ends):
            left, top = origin(tile, height)
            _read(d_image[0], left, top, d_red)
            _read(d_image[1], left, top, d_green)
            _read(d_image[2], left, top, d_blue)
            transmittance[:], behind[:] = 1.0, 0.0
            for channel in range(3):
                _add_product(image[channel], d_image[channel], left, top, behind)
            for index in range(ranges[tile], drawn_ends[tile]):
                entry = entries[index]
                splat = splats[entry[ENTRY_SPLAT]]
                total = _replay(splat, entry[ENTRY_ROWS], left, top, transmittance, behind, d_red, d_green, d_blue)
                store(entry_sums, entry[ENTRY_SLOT] * LANES, total)
            for index in range(drawn_ends[tile], ranges[tile + 1]):
                store(entry_sums, entries[index, ENTRY_SLOT] * LANES, broadcast(ZERO))
            tile = take(counter)
