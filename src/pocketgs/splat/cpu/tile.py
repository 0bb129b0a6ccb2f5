"""Tile operations shared by forward and backward pass: one splat's α on the LANES pixels of a vector."""

from __future__ import annotations

import numpy as np

from pocketgs.splat.constants import TRANSMITTANCE_MIN
from pocketgs.splat.cpu.exp2 import exp2_of_negative
from pocketgs.splat.cpu.lanes import LANES, Floats, Mask, any_lane, broadcast, constant, load, magnitude, select
from pocketgs.splat.cpu.layout import (
    EXPONENT_XX,
    EXPONENT_XY,
    EXPONENT_YY,
    LOG2_ALPHA_MIN,
    LOG2_OPACITY,
    MEAN_X,
    MEAN_Y,
    TILE_HEIGHT,
    TILE_PIXELS,
    TILE_WIDTH,
    tiles_down,
)
from pocketgs.system.compile import inlined, part

AHEAD = 4
"""Number of intersections to prefetch ahead."""

ROWS_PER_VECTOR = LANES // TILE_WIDTH
ZERO = np.float32(0.0)
ONE = np.float32(1.0)
_SATURATED = np.float32(TRANSMITTANCE_MIN)

ExponentTerms = tuple[Floats, Floats, float]
"""The constant, linear and quadratic term of log2 α in dy."""

_columns = constant(np.tile(np.arange(TILE_WIDTH) + 0.5, ROWS_PER_VECTOR))
_rows = constant(np.repeat(np.arange(ROWS_PER_VECTOR) + 0.5, TILE_WIDTH))


@part
def origin(tile: int, height: int) -> tuple[int, int]:
    """Top left pixel (x, y) of a tile; tiles are numbered down the columns."""
    down = tiles_down(height)
    return tile // down * TILE_WIDTH, tile % down * TILE_HEIGHT


@inlined
def first_and_end_pixel(rows: int) -> tuple[int, int]:
    """First and end pixel, row-major in the tile, of the vectors that cover an intersection's rows."""
    return (rows >> 8) // ROWS_PER_VECTOR * LANES, (rows & 255) * TILE_WIDTH


@inlined
def column_offsets(splat: np.ndarray, left: int) -> Floats:
    """Dx from the splat's centre to the pixels of a vector: the same for all vectors of a tile."""
    return _columns() + np.float32(left - splat[MEAN_X])


@inlined
def row_offsets(splat: np.ndarray, top: int, pixel: int) -> Floats:
    """Dy from the splat's centre to the pixels of the vector that begins at `pixel`."""
    return _rows() + np.float32(np.float32(top + pixel // TILE_WIDTH) - splat[MEAN_Y])


@inlined
def exponent_terms(splat: np.ndarray, dx: Floats) -> ExponentTerms:
    """The parts of log2 α that do not depend on dy: log2 α = constant + dy (linear + quadratic dy)."""
    return splat[EXPONENT_XX] * (dx * dx) + splat[LOG2_OPACITY], splat[EXPONENT_XY] * dx, splat[EXPONENT_YY]


@inlined
def alpha_at(terms: ExponentTerms, dy: Floats, transmittance: Floats, most_opaque: float) -> tuple[Floats, Floats]:
    """α before and after clamping; the latter is 0 where α is under 1/255 or the pixel is saturated."""
    constant_term, linear, quadratic = terms
    exponent = constant_term + dy * (linear + quadratic * dy)
    unclamped = exp2_of_negative(exponent)
    drawn = (exponent >= broadcast(LOG2_ALPHA_MIN)) & (transmittance >= broadcast(_SATURATED))
    return unclamped, select(drawn, min(unclamped, most_opaque), broadcast(ZERO))


@inlined
def fills(transmittance: Floats, rest: Floats) -> tuple[Mask, Floats]:
    """Mask of pixels that a splat would saturate, and the transmittance if they skip it; `rest` is that behind it.

    A negative transmittance marks a pixel as full: `alpha_at` draws nothing there.
    """
    full = broadcast(_SATURATED) >= rest
    return full, select(full, magnitude(transmittance) * -ONE, rest)


@part
def forget_full_pixels(transmittance: np.ndarray) -> None:
    """Remove the negative signs that `fills` has set."""
    for pixel in range(TILE_PIXELS):
        transmittance[pixel] = abs(transmittance[pixel])


@part
def pixels_inside(left: int, top: int, width: int, height: int, inside: np.ndarray) -> None:
    """Write 1 for every pixel of a tile inside the image, and 0 for the others."""
    for row in range(TILE_HEIGHT):
        for column in range(TILE_WIDTH):
            inside[row * TILE_WIDTH + column] = 1.0 if top + row < height and left + column < width else 0.0


@part
def is_saturated(transmittance: np.ndarray) -> bool:
    """Whether all pixels of the tile are saturated."""
    clearest = load(transmittance, 0)
    for pixel in range(LANES, TILE_PIXELS, LANES):
        clearest = max(clearest, load(transmittance, pixel))
    return not any_lane(clearest >= broadcast(_SATURATED))
