"""The gradient of rasterization, by replaying each tile front to back.

The paper caches {C_in, α} of every contribution. No cache is needed here: with D_i = c_i · ∂L/∂C, the splats behind
splat i enter its gradient only as the number H_i = Σ_{j>i} w_j D_j + T·background·∂L/∂C. It starts at C · ∂L/∂C, and
every contribution subtracts w_i D_i. Recomputing α takes some twenty instructions per vector, and no memory.
"""

from __future__ import annotations

import numpy as np
from numba import prange

from pocketgs.splat.cpu.bin import TileLists
from pocketgs.splat.cpu.lanes import LANES, Floats, broadcast, load, prefetch, select, store
from pocketgs.splat.cpu.layout import (
    COLOURS,
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
    fills,
    first_and_end_pixel,
    origin,
    row_offsets,
)
from pocketgs.splat.cpu.tile_image import TileImage, add_product, read_tile
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
    """Replay one splat in one tile; returns the vector of its sums."""
    dx = column_offsets(splat, left)
    terms = exponent_terms(splat, dx)
    found, pulled = no_sums(channels, more_sums)
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
        d_colour, product = take_gradient(splat, pixel, channels, weight, d_colours, more_sums)
        gain = weight * product
        rest = load(behind, pixel) - gain
        store(behind, pixel, rest)
        # ∂L/∂(ln α) = α ∂L/∂α = α (T D - H / (1 - α)); 0 where α is clamped.
        v = gain - rest * (alpha / (ONE - alpha))
        v = select(unclamped < broadcast(most_opaque), v, broadcast(ZERO))
        found = with_pixels(found, dy, v, weight, d_colour)
        if absolute:
            pulled = with_pulls(pulled, splat, dx, dy, v)
    return summed_up(dx, found, absolute, pulled)


@parallel_kernel
def rasterize_backward(
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
    """Replay all tiles.

    Args:
        splats: (N, FIRST_CHANNEL + C) from `project`, C at least 3.
        lists: of the image.
        limits: the limits of the forward pass.
        threads: number of threads.
        drawn: the image from `rasterize`.
        d_image: (C, H, W) float32 gradient with respect to `drawn.image`.
        d_transmittance: (H, W) float32 gradient with respect to `drawn.transmittance`, besides that through the
            image's background, or (0, 0) for none.
        absolute: whether to sum the magnitudes of the pixels' gradients of the splat's centre.
        intersection_sums: (intersections · sums_per_intersection(C),) float32, written: one row per
            intersection, at its slot.
    """
    channels, height = drawn.image.shape[:2]
    row = sums_per_intersection(channels)
    counter = first_piece()
    for _ in prange(threads):
        transmittance, behind = np.empty(TILE_PIXELS, np.float32), np.empty(TILE_PIXELS, np.float32)
        d_colours = np.empty(channels * TILE_PIXELS, np.float32)
        more_sums = np.empty((channels - COLOURS) * LANES, np.float32)
        tile = take(counter)
        while tile < len(drawn.drawn_ends):
            left, top = origin(tile, height)
            transmittance[:], behind[:] = 1.0, 0.0
            for channel in range(channels):
                read_tile(d_image[channel], left, top, d_colours[channel * TILE_PIXELS : (channel + 1) * TILE_PIXELS])
                add_product(drawn.image[channel], d_image[channel], left, top, behind)
            if d_transmittance.size:
                add_product(drawn.transmittance, d_transmittance, left, top, behind)
            drawn_end = drawn.drawn_ends[tile]
            for index in range(lists.ranges[tile], drawn_end):
                intersection = lists.intersections[index]
                if index + AHEAD < drawn_end:
                    prefetch(splats, lists.intersections[index + AHEAD, INTERSECTION_SPLAT])
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
            for index in range(drawn_end, lists.ranges[tile + 1]):
                slot = lists.intersections[index, INTERSECTION_SLOT]
                intersection_sums[slot * row : (slot + 1) * row] = 0.0
            tile = take(counter)
