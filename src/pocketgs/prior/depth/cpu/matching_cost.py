"""Matching costs of a plane sweep: Hamming distances of the census transforms of a view and its warped source views.

The census transform (Zabih and Woodfill 1994) encodes a pixel's neighbourhood as bits: which neighbours are darker. It
is invariant to gain, offset and vignetting.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import prange

from pocketgs.prior.depth.sweep_constants import BITS, RADIUS
from pocketgs.system.compile import parallel_kernel, part

NEIGHBOURS = np.array(
    [(y, x) for y in range(-RADIUS, RADIUS + 1) for x in range(-RADIUS, RADIUS + 1) if (y, x) != (0, 0)], np.int64
)
"""(row, column) offsets of the neighbours that each pixel is compared with."""

UNSEEN = np.uint8(255)

ROWS_AT_ONCE = 32
"""Rows per thread: their costs for all hypotheses fit in the cache."""


ALL_USABLE = np.zeros((0, 0, 0), np.bool_)


class SourceViews(NamedTuple):
    """The source views of a view, and the mapping of its pixels into them.

    A pixel (x, y, 1) of the view, at inverse depth i, falls at (u/w, v/w) of a source view, where
    (u, v, w) = turn · (x, y, 1) + i · shift.

    Attributes:
        squares: (R, h, w) uint32: grey levels of each pixel, its right neighbour, and the two below, one byte each from
            the lowest. One read returns all four values to interpolate. Padded to one size.
        sizes: (R, 2) float32 true heights and widths.
        turns: (R, 3, 3) float32.
        shifts: (R, 3) float32.
        usable: (R, h, w) bool, unmasked pixels, or `ALL_USABLE` without masks. The source view does not see hypotheses
            that fall on masked pixels.
    """

    squares: np.ndarray
    sizes: np.ndarray
    turns: np.ndarray
    shifts: np.ndarray
    usable: np.ndarray = ALL_USABLE


def squares_of(image: np.ndarray) -> np.ndarray:
    """(H, W) uint32 squares, as in `SourceViews`, of an (H, W) uint8 image whose border pixels are repeated."""
    wide = np.pad(image, ((0, 1), (0, 1)), mode="edge").astype(np.uint32)
    return wide[:-1, :-1] | wide[:-1, 1:] << 8 | wide[1:, :-1] << 16 | wide[1:, 1:] << 24


@parallel_kernel
def matching_costs(view: np.ndarray, source_views: SourceViews, inverse_depths: np.ndarray) -> np.ndarray:
    """Compare a view with its source views, warped by every hypothesis.

    With several source views, a hypothesis costs the mean of the two that agree best: few surfaces are occluded in all
    but one.

    Args:
        view: (H, W) uint8 greyscale image.
        source_views: to compare it with.
        inverse_depths: (D,) float32 hypotheses.

    Returns:
        (H, W, D) uint8 Hamming distance, at most BITS; BITS / 2 where no source view sees the hypothesis.
    """
    height, width = view.shape
    costs = np.empty((height, width, len(inverse_depths)), np.uint8)
    for band in prange((height + ROWS_AT_ONCE - 1) // ROWS_AT_ONCE):
        top = band * ROWS_AT_ONCE
        rows = min(ROWS_AT_ONCE, height - top)
        darker = census(view, top, rows)
        warped = np.empty((rows + 2 * RADIUS, width + 2 * RADIUS), np.uint8)
        visible = np.empty(warped.shape, np.bool_)
        least, next_least = np.empty((rows, width), np.uint8), np.empty((rows, width), np.uint8)
        for hypothesis in range(len(inverse_depths)):
            least[:], next_least[:] = UNSEEN, UNSEEN
            for source in range(len(source_views.squares)):
                warp(source_views, source, inverse_depths[hypothesis], top, warped, visible)
                compare(darker, warped, visible, least, next_least)
            write_costs(least, next_least, costs[top : top + rows], hypothesis)
    return costs


@part
def census(view: np.ndarray, top: int, rows: int) -> np.ndarray:
    """(BITS, rows, W) uint8: 1 where a neighbour is darker. The image's border pixels are repeated."""
    height, width = view.shape
    darker = np.empty((BITS, rows, width), np.uint8)
    for bit in range(BITS):
        for row in range(rows):
            neighbour_row = min(max(top + row + NEIGHBOURS[bit, 0], 0), height - 1)
            for column in range(width):
                neighbour = view[neighbour_row, min(max(column + NEIGHBOURS[bit, 1], 0), width - 1)]
                darker[bit, row, column] = neighbour < view[top + row, column]
    return darker


@part
def warp(
    source_views: SourceViews, source: int, inverse_depth: np.float32, top: int, warped: np.ndarray, visible: np.ndarray
) -> None:
    """Sample a source view bilinearly at the rows of the view from `top` on, with a margin of RADIUS.

    A row takes three passes: the first and the last are vectorised, the second only reads.
    """
    squares = source_views.squares[source].reshape(-1)
    turn, shift = source_views.turns[source], source_views.shifts[source] * inverse_depth
    size, stride = source_views.sizes[source], source_views.squares.shape[2]
    columns = warped.shape[1]
    # Separate arrays: Numba does not know that rows of one array are contiguous, and would not vectorise.
    places, read = np.empty(columns, np.uint32), np.empty(columns, np.uint32)
    right_shares, below_shares = np.empty(columns, np.float32), np.empty(columns, np.float32)
    for row in range(len(warped)):
        y = np.float32(top + row - RADIUS) + np.float32(0.5)
        find(turn, shift, y, size, stride, places, right_shares, below_shares, visible[row])
        for column in range(columns):
            read[column] = squares[places[column]]
        interpolate(read, right_shares, below_shares, warped[row])
        if len(source_views.usable):
            usable = source_views.usable[source].reshape(-1)
            for column in range(columns):
                visible[row, column] &= usable[places[column]]


@part
def find(
    turn: np.ndarray,
    shift: np.ndarray,
    y: np.float32,
    size: np.ndarray,
    stride: int,
    places: np.ndarray,
    right_shares: np.ndarray,
    below_shares: np.ndarray,
    visible: np.ndarray,
) -> None:
    """Map the pixels of a row: index of the square, and weights of its right and lower pixels, where visible."""
    half, zero = np.float32(0.5), np.float32(0.0)
    height, width = size
    along_u, along_v, along_w = turn[0, 0], turn[1, 0], turn[2, 0]
    start_u = turn[0, 1] * y + turn[0, 2] + shift[0]
    start_v = turn[1, 1] * y + turn[1, 2] + shift[1]
    start_w = turn[2, 1] * y + turn[2, 2] + shift[2]
    pitch = np.uint32(stride)
    for column in range(len(places)):
        x = np.float32(column - RADIUS) + half
        w = along_w * x + start_w
        across, down = (along_u * x + start_u) / w, (along_v * x + start_v) / w
        visible[column] = (w > zero) & (across >= zero) & (across < width) & (down >= zero) & (down < height)
        # In this order of arguments, 0 / 0 becomes 0 and all reads stay in bounds.
        across = min(max(zero, across - half), width - np.float32(1.0))
        down = min(max(zero, down - half), height - np.float32(1.0))
        left, above = np.int32(across), np.int32(down)
        right_shares[column], below_shares[column] = across - np.float32(left), down - np.float32(above)
        places[column] = np.uint32(above) * pitch + np.uint32(left)


@part
def interpolate(squares: np.ndarray, right_shares: np.ndarray, below_shares: np.ndarray, samples: np.ndarray) -> None:
    """Interpolate the four grey levels of each square."""
    byte, half = np.uint32(255), np.float32(0.5)
    for column in range(len(samples)):
        square = squares[column]
        top_left, top_right = np.float32(square & byte), np.float32((square >> np.uint32(8)) & byte)
        low_left, low_right = np.float32((square >> np.uint32(16)) & byte), np.float32(square >> np.uint32(24))
        upper = top_left + (top_right - top_left) * right_shares[column]
        lower = low_left + (low_right - low_left) * right_shares[column]
        samples[column] = np.uint8(np.int32(upper + (lower - upper) * below_shares[column] + half))


@part
def compare(
    darker: np.ndarray, warped: np.ndarray, visible: np.ndarray, least: np.ndarray, next_least: np.ndarray
) -> None:
    """Count differing bits, and keep the two smallest counts per pixel."""
    rows, width = least.shape
    count = np.empty(width, np.uint8)
    for row in range(rows):
        count[:] = 0
        centre = warped[row + RADIUS, RADIUS : RADIUS + width]
        for bit in range(BITS):
            start = RADIUS + NEIGHBOURS[bit, 1]
            neighbour = warped[row + RADIUS + NEIGHBOURS[bit, 0], start : start + width]
            own = darker[bit, row]
            for column in range(width):
                count[column] += np.uint8(neighbour[column] < centre[column]) ^ own[column]
        first, second = least[row], next_least[row]
        seen = visible[row + RADIUS, RADIUS : RADIUS + width]
        for column in range(width):
            value = count[column] if seen[column] else UNSEEN
            second[column] = min(second[column], max(first[column], value))
            first[column] = min(first[column], value)


@part
def write_costs(least: np.ndarray, next_least: np.ndarray, costs: np.ndarray, hypothesis: int) -> None:
    """Write the costs of one hypothesis."""
    rows, width = least.shape
    for row in range(rows):
        for column in range(width):
            first, second = least[row, column], next_least[row, column]
            if first == UNSEEN:
                costs[row, column, hypothesis] = np.uint8(BITS // 2)
            elif second == UNSEEN:
                costs[row, column, hypothesis] = first
            else:
                costs[row, column, hypothesis] = np.uint8((np.int64(first) + np.int64(second)) >> 1)
