"""The gradient of rasterization, by replaying each tile front to back.

The paper caches {C_in, α} of every contribution. No cache is needed here: with D_i = c_i · ∂L/∂C, the splats behind
splat i enter its gradient only as the number H_i = Σ_{j>i} w_j D_j + T·background·∂L/∂C. It starts at C · ∂L/∂C, and
every contribution subtracts w_i D_i. Recomputing α takes some twenty instructions per vector, and no memory.
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from pocketgs.splat.cpu.lanes import LANES, Floats, broadcast, load, magnitude, prefetch, select, store, sums
from pocketgs.splat.cpu.layout import (
    BLUE,
    COLOURS,
    EXPONENT_XX,
    EXPONENT_XY,
    EXPONENT_YY,
    FIRST_CHANNEL,
    GREEN,
    INTERSECTION_ROWS,
    INTERSECTION_SLOT,
    INTERSECTION_SPLAT,
    RED,
    TILE_HEIGHT,
    TILE_PIXELS,
    TILE_WIDTH,
)
from pocketgs.splat.cpu.rasterize import AHEAD
from pocketgs.splat.cpu.tile import (
    ONE,
    ZERO,
    alpha_at,
    column_offsets,
    exponent_terms,
    fills,
    first_and_end_pixel,
    origin,
    row_offsets,
)
from pocketgs.splat.limits import Limits
from pocketgs.system.compile import inlined, parallel_kernel, part
from pocketgs.system.dealing import first_piece, take

# Sums of a splat's replay in one tile: over pixels, v = ∂L/∂(ln α) times 1, dx, dy, dx², dx dy, dy²; the gradients of
# its first three channels; and the absolute gradients of its centre. Sums of other channels follow.
SUM_EXPONENT, SUM_X, SUM_Y, SUM_XX, SUM_XY, SUM_YY, SUM_RED, SUM_GREEN, SUM_BLUE, SUM_ABSOLUTE_X, SUM_ABSOLUTE_Y = (
    range(11)
)
LN2 = np.float32(math.log(2.0))


@part
def sums_per_intersection(channels: int) -> int:
    """Length of an intersection's row of sums: a multiple of LANES, with room for the channels after the third."""
    return LANES * (1 + (max(channels, COLOURS) - COLOURS + LANES - 1) // LANES)


@inlined
def take_gradient(
    splat: np.ndarray, pixel: int, channels: int, weight: Floats, d_colours: np.ndarray, more_sums: np.ndarray
) -> tuple[Floats, Floats, Floats, Floats]:
    """Gradients of the image's first three channels at some pixels, and c · ∂L/∂C over all channels.

    Gradients of further channels, times the splat's weight, are added to `more_sums`.
    """
    r, g = load(d_colours, pixel), load(d_colours, TILE_PIXELS + pixel)
    b = load(d_colours, 2 * TILE_PIXELS + pixel)
    product = r * splat[RED] + g * splat[GREEN] + b * splat[BLUE]
    for channel in range(COLOURS, channels):
        d, place = load(d_colours, channel * TILE_PIXELS + pixel), (channel - COLOURS) * LANES
        product = product + d * splat[FIRST_CHANNEL + channel]
        store(more_sums, place, load(more_sums, place) + weight * d)
    return r, g, b, product


@inlined
def pulls(splat: np.ndarray, dx: Floats, dy: Floats, v: Floats) -> tuple[Floats, Floats]:
    """Magnitudes of pixels' gradients of the splat's centre, x and y, from v = ∂L/∂(ln α); to be multiplied by ln 2."""
    slope_x = splat[EXPONENT_XX] * (dx + dx) + splat[EXPONENT_XY] * dy
    slope_y = splat[EXPONENT_XY] * dx + splat[EXPONENT_YY] * (dy + dy)
    return magnitude(v * slope_x), magnitude(v * slope_y)


@inlined
def summed_up(
    dx: Floats,
    moments: tuple[Floats, Floats, Floats],
    colours: tuple[Floats, Floats, Floats],
    absolute: bool,
    pulled: tuple[Floats, Floats],
) -> Floats:
    """Vector of a splat's sums over a tile's pixels, from sums over rows of v, v dy and v dy²."""
    v_sum, vy_sum, vyy_sum = moments
    # dx is the same in every row, so its powers multiply once.
    vx_sum = v_sum * dx
    shape = (v_sum, vx_sum, vy_sum, vx_sum * dx, vy_sum * dx, vyy_sum)
    if absolute:
        return sums((*shape, *colours, pulled[0] * LN2, pulled[1] * LN2))
    return sums((*shape, *colours))


@inlined
def _replay(
    splat: np.ndarray,
    rows: int,
    left: int,
    top: int,
    channels: int,
    absolute: bool,
    most_opaque: float,
    stops_before: bool,
    transmittance: np.ndarray,
    behind: np.ndarray,
    d_colours: np.ndarray,
    more_sums: np.ndarray,
) -> Floats:
    """Replay one splat in one tile; returns the vector of its sums.

    Sums of the first three channels stay in registers; those of further channels are in memory, in `more_sums`, one
    vector each.
    """
    dx = column_offsets(splat, left)
    terms = exponent_terms(splat, dx)
    v_sum = vy_sum = vyy_sum = red_sum = green_sum = blue_sum = absolute_x = absolute_y = broadcast(ZERO)
    for channel in range(COLOURS, channels):
        store(more_sums, (channel - COLOURS) * LANES, broadcast(ZERO))
    first, end = first_and_end_pixel(rows)
    for pixel in range(first, end, LANES):
        t = load(transmittance, pixel)
        dy = row_offsets(splat, top, pixel)
        unclamped, alpha = alpha_at(terms, dy, t, most_opaque)
        weight = alpha * t
        left_over = t - weight
        if stops_before:
            full, left_over = fills(t, left_over)
            alpha, weight = select(full, broadcast(ZERO), alpha), select(full, broadcast(ZERO), weight)
        store(transmittance, pixel, left_over)
        r, g, b, product = take_gradient(splat, pixel, channels, weight, d_colours, more_sums)
        gain = weight * product
        rest = load(behind, pixel) - gain
        store(behind, pixel, rest)
        # ∂L/∂(ln α) = α ∂L/∂α = α (T D - H / (1 - α)); 0 where α is clamped.
        v = gain - rest * (alpha / (ONE - alpha))
        v = select(unclamped < broadcast(most_opaque), v, broadcast(ZERO))
        vy = v * dy
        v_sum, vy_sum, vyy_sum = v_sum + v, vy_sum + vy, vyy_sum + vy * dy
        red_sum, green_sum, blue_sum = red_sum + weight * r, green_sum + weight * g, blue_sum + weight * b
        if absolute:
            pull_x, pull_y = pulls(splat, dx, dy, v)
            absolute_x, absolute_y = absolute_x + pull_x, absolute_y + pull_y
    colours = (red_sum, green_sum, blue_sum)
    return summed_up(dx, (v_sum, vy_sum, vyy_sum), colours, absolute, (absolute_x, absolute_y))


@inlined
def write_sums(intersection_sums: np.ndarray, first: int, total: Floats, channels: int, more_sums: np.ndarray) -> None:
    """Write an intersection's row of sums."""
    store(intersection_sums, first, total)
    for channel in range(COLOURS, channels):
        own = more_sums[(channel - COLOURS) * LANES : (channel - COLOURS + 1) * LANES]
        intersection_sums[first + LANES + channel - COLOURS] = own.sum()


@part
def read_tile(image: np.ndarray, left: int, top: int, tile_pixels: np.ndarray) -> None:
    """Copy a tile of an image; pixels outside the image are 0."""
    tile_pixels[:] = 0.0
    for row in range(min(TILE_HEIGHT, image.shape[0] - top)):
        for column in range(min(TILE_WIDTH, image.shape[1] - left)):
            tile_pixels[row * TILE_WIDTH + column] = image[top + row, left + column]


@part
def add_product(image: np.ndarray, d_image: np.ndarray, left: int, top: int, tile_pixels: np.ndarray) -> None:
    """Add an image times its gradient to a tile."""
    for row in range(min(TILE_HEIGHT, image.shape[0] - top)):
        for column in range(min(TILE_WIDTH, image.shape[1] - left)):
            product = image[top + row, left + column] * d_image[top + row, left + column]
            tile_pixels[row * TILE_WIDTH + column] += product


@parallel_kernel
def rasterize_backward(
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
    """Replay all tiles.

    Args:
        splats: (N, FIRST_CHANNEL + C) from `project`, C at least 3.
        intersections: (E, INTERSECTION_FIELDS) int32, the tile lists; see `TileLists`.
        ranges: (tiles + 1,) int32, start of each tile's intersections.
        drawn_ends: (tiles,) int32 from `rasterize`.
        limits: the limits of the forward pass.
        threads: number of threads.
        image: (C, H, W) float32 from `rasterize`.
        d_image: (C, H, W) float32 gradient with respect to `image`.
        transmittance_image: (H, W) float32 from `rasterize`.
        d_transmittance: (H, W) float32 gradient with respect to it, besides that through the image's background, or
            (0, 0) for none.
        absolute: whether to sum the magnitudes of the pixels' gradients of the splat's centre.
        intersection_sums: (intersections · sums_per_intersection(C),) float32, written: one row per
            intersection, at its slot.
    """
    channels, height = image.shape[:2]
    row = sums_per_intersection(channels)
    counter = first_piece()
    for _ in prange(threads):
        transmittance, behind = np.empty(TILE_PIXELS, np.float32), np.empty(TILE_PIXELS, np.float32)
        d_colours = np.empty(channels * TILE_PIXELS, np.float32)
        more_sums = np.empty((channels - COLOURS) * LANES, np.float32)
        tile = take(counter)
        while tile < len(drawn_ends):
            left, top = origin(tile, height)
            transmittance[:], behind[:] = 1.0, 0.0
            for channel in range(channels):
                read_tile(d_image[channel], left, top, d_colours[channel * TILE_PIXELS : (channel + 1) * TILE_PIXELS])
                add_product(image[channel], d_image[channel], left, top, behind)
            if d_transmittance.size:
                add_product(transmittance_image, d_transmittance, left, top, behind)
            for index in range(ranges[tile], drawn_ends[tile]):
                intersection = intersections[index]
                if index + AHEAD < drawn_ends[tile]:
                    prefetch(splats, intersections[index + AHEAD, INTERSECTION_SPLAT])
                splat, rows = splats[intersection[INTERSECTION_SPLAT]], intersection[INTERSECTION_ROWS]
                first, most_opaque = intersection[INTERSECTION_SLOT] * row, limits.most_opaque
                # Constants let the compiler remove unused branches.
                if channels == COLOURS and not absolute and not limits.stops_before:
                    total = _replay(
                        splat, rows, left, top, COLOURS, False, most_opaque, False,
                        transmittance, behind, d_colours, more_sums,
                    )  # fmt: skip
                elif channels == COLOURS and not absolute:
                    total = _replay(
                        splat, rows, left, top, COLOURS, False, most_opaque, True,
                        transmittance, behind, d_colours, more_sums,
                    )  # fmt: skip
                else:
                    total = _replay(
                        splat, rows, left, top, channels, absolute, most_opaque, limits.stops_before,
                        transmittance, behind, d_colours, more_sums,
                    )  # fmt: skip
                write_sums(intersection_sums, first, total, channels, more_sums)
            for index in range(drawn_ends[tile], ranges[tile + 1]):
                slot = intersections[index, INTERSECTION_SLOT]
                intersection_sums[slot * row : (slot + 1) * row] = 0.0
            tile = take(counter)
