"""Sums of a splat's gradients over the pixels of a tile, which all compositing rules make.

Sums of the first three channels and of the shape stay in registers; those of further channels are in memory, in
`more_sums`, one vector each.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from pocketgs.splat.cpu.lanes import LANES, Floats, broadcast, load, magnitude, store, sums
from pocketgs.splat.cpu.layout import (
    BLUE,
    COLOURS,
    EXPONENT_XX,
    EXPONENT_XY,
    EXPONENT_YY,
    FIRST_CHANNEL,
    GREEN,
    RED,
    TILE_PIXELS,
)
from pocketgs.splat.cpu.tile import ZERO
from pocketgs.system.compile import inlined, part

# An intersection's row of sums: over pixels, v = ∂L/∂(ln α) times 1, dx, dy, dx², dx dy, dy²; the gradients of the
# first three channels; and the absolute gradients of the splat's centre. Sums of other channels follow.
SUM_EXPONENT, SUM_X, SUM_Y, SUM_XX, SUM_XY, SUM_YY, SUM_RED, SUM_GREEN, SUM_BLUE, SUM_ABSOLUTE_X, SUM_ABSOLUTE_Y = (
    range(11)
)
LN2 = np.float32(math.log(2.0))

Pair = tuple[Floats, Floats]


@part
def sums_per_intersection(channels: int) -> int:
    """Length of an intersection's row of sums: a multiple of LANES, with room for the channels after the third."""
    return LANES * (1 + (max(channels, COLOURS) - COLOURS + LANES - 1) // LANES)


class PixelSums(NamedTuple):
    """A splat's sums over the rows of a tile, a column of pixels in each lane.

    Attributes:
        v, v_y, v_yy: Σ v, Σ v dy and Σ v dy², with v = ∂L/∂(ln α).
        red, green, blue: gradients of the splat's first three channels.
    """

    v: Floats
    v_y: Floats
    v_yy: Floats
    red: Floats
    green: Floats
    blue: Floats


@inlined
def no_sums(channels: int, more_sums: np.ndarray) -> tuple[PixelSums, Pair]:
    """Sums of no pixels for `with_pixels` and `with_pulls`; `more_sums` is set to 0."""
    zero = broadcast(ZERO)
    for channel in range(COLOURS, channels):
        store(more_sums, (channel - COLOURS) * LANES, zero)
    return PixelSums(zero, zero, zero, zero, zero, zero), (zero, zero)


@inlined
def take_gradient(
    splat: np.ndarray, pixel: int, channels: int, weight: Floats, d_colours: np.ndarray, more_sums: np.ndarray
) -> tuple[tuple[Floats, Floats, Floats], Floats]:
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
    return (r, g, b), product


@inlined
def with_pixels(
    so_far: PixelSums, dy: Floats, v: Floats, weight: Floats, d_colour: tuple[Floats, Floats, Floats]
) -> PixelSums:
    """The sums with some more pixels, from v = ∂L/∂(ln α), the splat's weight and the gradients of their colours."""
    v_y = v * dy
    r, g, b = d_colour
    return PixelSums(
        so_far.v + v,
        so_far.v_y + v_y,
        so_far.v_yy + v_y * dy,
        so_far.red + weight * r,
        so_far.green + weight * g,
        so_far.blue + weight * b,
    )


@inlined
def with_pulls(so_far: Pair, splat: np.ndarray, dx: Floats, dy: Floats, v: Floats) -> Pair:
    """Sums of the magnitudes of the gradients of the splat's centre, x and y, with some more pixels; without ln 2.

    They are apart from `PixelSums`: together, both take more registers than there are where `absolute` is no constant.
    """
    slope_x = splat[EXPONENT_XX] * (dx + dx) + splat[EXPONENT_XY] * dy
    slope_y = splat[EXPONENT_XY] * dx + splat[EXPONENT_YY] * (dy + dy)
    return (so_far[0] + magnitude(v * slope_x), so_far[1] + magnitude(v * slope_y))


@inlined
def summed_up(dx: Floats, found: PixelSums, absolute: bool, pulled: Pair) -> Floats:
    """The vector of a splat's sums over all pixels of a tile."""
    # dx is the same in every row, so its powers multiply once.
    v_x = found.v * dx
    shape = (found.v, v_x, found.v_y, v_x * dx, found.v_y * dx, found.v_yy)
    colours = (found.red, found.green, found.blue)
    if absolute:
        return sums((*shape, *colours, pulled[0] * LN2, pulled[1] * LN2))
    return sums((*shape, *colours))


@inlined
def write_sums(intersection_sums: np.ndarray, first: int, total: Floats, channels: int, more_sums: np.ndarray) -> None:
    """Write an intersection's row of sums."""
    store(intersection_sums, first, total)
    for channel in range(COLOURS, channels):
        own = more_sums[(channel - COLOURS) * LANES : (channel - COLOURS + 1) * LANES]
        intersection_sums[first + LANES + channel - COLOURS] = own.sum()
