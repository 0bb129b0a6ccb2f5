"""Conversion of arrays of splats to the rows that tiles draw, and of tile sums to gradients of the arrays."""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from pocketgs.splat.constants import ALPHA_MIN, CULLED, MIN_DETERMINANT
from pocketgs.splat.cpu.lanes import LANES
from pocketgs.splat.cpu.layout import (
    COLOURS,
    DEPTH,
    EXPONENT_XX,
    EXPONENT_XY,
    EXPONENT_YY,
    FIRST_CHANNEL,
    LOG2_OPACITY,
    MEAN_X,
    MEAN_Y,
    SLOTS_COUNT,
    SLOTS_FIRST,
)
from pocketgs.splat.cpu.tile_sums import (
    SUM_ABSOLUTE_X,
    SUM_ABSOLUTE_Y,
    SUM_EXPONENT,
    SUM_RED,
    SUM_X,
    SUM_XX,
    SUM_XY,
    SUM_Y,
    SUM_YY,
)
from pocketgs.system.compile import parallel_kernel, part
from pocketgs.system.dealing import PIECE, first_piece, take

_HALF_LOG2_E = 0.5 / math.log(2.0)


@part
def _write_shape(centre: np.ndarray, conic: np.ndarray, opacity: float, splat: np.ndarray) -> bool:
    """Write a splat's centre, conic and opacity; False if it cannot be drawn."""
    xx, xy, yy = float(conic[0]), float(conic[1]), float(conic[2])
    splat[MEAN_X], splat[MEAN_Y] = centre[0], centre[1]
    splat[EXPONENT_XX] = -_HALF_LOG2_E * xx
    splat[EXPONENT_XY] = -2.0 * _HALF_LOG2_E * xy
    splat[EXPONENT_YY] = -_HALF_LOG2_E * yy
    # Thinner needles become unbounded in float32, and would be listed in tiles that there are not.
    is_bounded = xx > 0.0 and yy > 0.0 and xx * yy - xy * xy > MIN_DETERMINANT * xx * yy
    if not (opacity >= ALPHA_MIN and is_bounded):
        return False
    splat[LOG2_OPACITY] = math.log2(opacity)
    return math.isfinite(float(centre[0]) + float(centre[1]) + xx + yy + opacity)


@parallel_kernel
def write_rows(
    centres: np.ndarray,
    conics: np.ndarray,
    opacities: np.ndarray,
    depths: np.ndarray,
    colours: np.ndarray,
    threads: int,
    splats: np.ndarray,
    depth_keys: np.ndarray,
) -> None:
    """Write the rows of splats.

    Args:
        centres: (N, 2) float32 in pixels.
        conics: (N, 3) float32: xx, xy, yy of the inverse covariance. If it is invalid, the splat is not drawn.
        opacities: (N,) float32.
        depths: (N,) float32, or (0,) if the order is not needed.
        colours: (N, C) float32, or (0, 0) if colours are not needed.
        threads: number of threads.
        splats: (N, FIRST_CHANNEL + max(C, 3)) float32, written, with zeros in channels past C.
        depth_keys: (N,) uint32, written: numbers in the order of the depths, or CULLED.
    """
    counter = first_piece()
    for _ in prange(threads):
        depth = np.empty(1, np.float32)
        bits = depth.view(np.uint32)
        first = PIECE * take(counter)
        while first < len(centres):
            for i in range(first, min(first + PIECE, len(centres))):
                splat = splats[i]
                depth_keys[i] = CULLED
                splat[DEPTH] = depths[i] if len(depths) else np.float32(1.0)
                if _write_shape(centres[i], conics[i], opacities[i], splat):
                    depth[0] = splat[DEPTH]
                    # The bits of negative numbers sort in reverse.
                    negative = bits[0] >> np.uint32(31)
                    depth_keys[i] = ~bits[0] if negative else bits[0] | np.uint32(0x80000000)
                if len(colours):
                    for channel in range(colours.shape[1]):
                        splat[FIRST_CHANNEL + channel] = colours[i, channel]
                    for channel in range(colours.shape[1], COLOURS):
                        splat[FIRST_CHANNEL + channel] = 0.0
            first = PIECE * take(counter)


@parallel_kernel
def gather_sums(
    conics: np.ndarray,
    opacities: np.ndarray,
    visible: np.ndarray,
    slots: np.ndarray,
    row: int,
    intersection_sums: np.ndarray,
    threads: int,
    d_centres: np.ndarray,
    d_absolute: np.ndarray,
    d_conics: np.ndarray,
    d_opacities: np.ndarray,
    d_colours: np.ndarray,
) -> None:
    """Gradients with respect to the arrays of splats, from the sums of their intersections.

    Args:
        conics: (N, 3) float32.
        opacities: (N,) float32.
        visible: (V,) int32 splats that are drawn.
        slots: (N, 2) int32 of `TileLists`.
        row: length of a row of `intersection_sums`.
        intersection_sums: from `rasterize_backward`.
        threads: number of threads.
        d_centres: (N, 2) float32, written where visible, as the following.
        d_absolute: (N, 2) float32 magnitudes of `d_centres` summed over pixels, or (0, 2).
        d_conics: (N, 3) float32.
        d_opacities: (N,) float32.
        d_colours: (N, C) float32.
    """
    counter = first_piece()
    for _ in prange(threads):
        total = np.empty(row, np.float32)
        first = PIECE * take(counter)
        while first < len(visible):
            for place in range(first, min(first + PIECE, len(visible))):
                i = visible[place]
                total[:] = 0.0
                for slot in range(slots[i, SLOTS_FIRST], slots[i, SLOTS_FIRST] + slots[i, SLOTS_COUNT]):
                    for k in range(row):
                        total[k] += intersection_sums[slot * row + k]
                x, y = total[SUM_X], total[SUM_Y]
                d_centres[i, 0] = conics[i, 0] * x + conics[i, 1] * y
                d_centres[i, 1] = conics[i, 1] * x + conics[i, 2] * y
                if len(d_absolute):
                    d_absolute[i, 0], d_absolute[i, 1] = total[SUM_ABSOLUTE_X], total[SUM_ABSOLUTE_Y]
                d_conics[i, 0], d_conics[i, 2] = -0.5 * total[SUM_XX], -0.5 * total[SUM_YY]
                d_conics[i, 1] = -total[SUM_XY]
                d_opacities[i] = total[SUM_EXPONENT] / opacities[i]
                for channel in range(d_colours.shape[1]):
                    at = SUM_RED + channel if channel < COLOURS else LANES + channel - COLOURS
                    d_colours[i, channel] = total[at]
            first = PIECE * take(counter)
