"""Bin splats into tiles, with each tile's list ordered by depth.

A tile is a strip of TILE_WIDTH x TILE_HEIGHT pixels. A splat intersects only the tiles where its ellipse of α = 1/255
reaches a row of pixel centres. The intersection stores these rows, so that rasterization visits few pixels in vain.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import prange

from pocketgs.splat.cpu.lanes import prefetch
from pocketgs.splat.cpu.layout import (
    EXPONENT_XX,
    EXPONENT_XY,
    EXPONENT_YY,
    INTERSECTION_FIELDS,
    INTERSECTION_ROWS,
    INTERSECTION_SLOT,
    INTERSECTION_SPLAT,
    LOG2_ALPHA_MIN,
    LOG2_OPACITY,
    MEAN_X,
    MEAN_Y,
    SLOTS_COUNT,
    SLOTS_FIRST,
    TILE_HEIGHT,
    TILE_WIDTH,
    View,
    tiles_down,
)
from pocketgs.system.compile import inlined, kernel, parallel_kernel, part
from pocketgs.system.dealing import first_piece, take

SHARES_PER_THREAD = 4
"""Number of shares of the splats, dealt out to threads; each has a row of counts per tile."""

AHEAD = 12
"""Number of splats to prefetch ahead."""

_LISTED_TILE, _LISTED_SPLAT, _LISTED_ROWS = range(3)


class TileLists(NamedTuple):
    """The splats that each tile draws.

    Attributes:
        intersections: (E, INTERSECTION_FIELDS) int32, tile after tile, nearest splat first.
        ranges: (tiles + 1,) int32, start of each tile's intersections.
        slots: (N, 2) int32, valid for visible Gaussians: SLOTS_FIRST and SLOTS_COUNT of their intersections' slots. A
            slot is the intersection's own row for gradients. Slots are in memory order of the Gaussians, not in depth
            order, so that gradients are gathered from contiguous memory.
    """

    intersections: np.ndarray
    ranges: np.ndarray
    slots: np.ndarray


class Ellipse(NamedTuple):
    """The ellipse A dx² + B dx dy + C dy² + reach = 0 with A, C < 0, prepared for intersection with vertical strips.

    At a given dx its rows are dy = slope·dx ± √(offset - curvature·dx²).
    """

    mean_x: float
    mean_y: float
    half_width: float
    dx_of_bottom: float
    slope: float
    offset: float
    curvature: float


@inlined
def ellipse_of(splat: np.ndarray) -> Ellipse:
    """The ellipse of α = 1/255 of a projected splat."""
    a, b, c = float(splat[EXPONENT_XX]), float(splat[EXPONENT_XY]), float(splat[EXPONENT_YY])
    reach = max(0.0, splat[LOG2_OPACITY] - LOG2_ALPHA_MIN)
    determinant = 4.0 * a * c - b * b
    half_width = math.sqrt(-4.0 * c * reach / determinant)
    half_height = math.sqrt(-4.0 * a * reach / determinant)
    return Ellipse(
        float(splat[MEAN_X]),
        float(splat[MEAN_Y]),
        half_width,
        -b / (2.0 * a) * half_height,
        -b / (2.0 * c),
        -reach / c,
        determinant / (4.0 * c * c),
    )


@inlined
def columns_reached(ellipse: Ellipse, width: int) -> tuple[int, int]:
    """First and one past the last column of tiles that the ellipse reaches."""
    first = int(max(np.ceil(ellipse.mean_x - ellipse.half_width - 0.5), 0.0))
    last = int(min(np.floor(ellipse.mean_x + ellipse.half_width - 0.5), width - 1.0))
    if first > last:
        return 0, 0
    return first // TILE_WIDTH, last // TILE_WIDTH + 1


@inlined
def rows_reached(ellipse: Ellipse, column: int, width: int, height: int) -> tuple[int, int]:
    """First and one past the last row of pixels that the ellipse reaches within a column of tiles.

    The extremes are the ellipse's own top and bottom if the column contains them, otherwise at the column's nearer
    edge.
    """
    left = column * TILE_WIDTH + 0.5 - ellipse.mean_x
    right = min((column + 1) * TILE_WIDTH, width) - 0.5 - ellipse.mean_x
    dx = min(max(ellipse.dx_of_bottom, left), right)
    bottom = ellipse.slope * dx + math.sqrt(max(0.0, ellipse.offset - ellipse.curvature * dx * dx))
    dx = min(max(-ellipse.dx_of_bottom, left), right)
    top = ellipse.slope * dx - math.sqrt(max(0.0, ellipse.offset - ellipse.curvature * dx * dx))
    first = int(min(max(np.ceil(ellipse.mean_y + top - 0.5), 0.0), float(height)))
    last = int(max(min(np.floor(ellipse.mean_y + bottom - 0.5), height - 1.0), -1.0))
    return first, last + 1


@part
def _list_range(
    splats: np.ndarray,
    order: np.ndarray,
    first_rank: int,
    end_rank: int,
    width: int,
    height: int,
    slots: np.ndarray,
    counts: np.ndarray,
    listed: np.ndarray,
) -> int:
    """List the intersections of the splats from `first_rank` up to `end_rank`, and count them by tile.

    Writes only as much as fits into `listed`, but returns the total number of intersections.
    """
    down = tiles_down(height)
    found = 0
    for rank in range(first_rank, end_rank):
        if rank + AHEAD < end_rank:
            prefetch(splats, order[rank + AHEAD])
        before = found
        ellipse = ellipse_of(splats[order[rank]])
        first_column, end_column = columns_reached(ellipse, width)
        for column in range(first_column, end_column):
            first, end = rows_reached(ellipse, column, width, height)
            if first < end:
                for tile_row in range(first // TILE_HEIGHT, (end - 1) // TILE_HEIGHT + 1):
                    tile, top = column * down + tile_row, tile_row * TILE_HEIGHT
                    counts[tile] += 1
                    if found < len(listed):
                        intersection = listed[found]
                        intersection[_LISTED_TILE] = tile
                        intersection[_LISTED_SPLAT] = order[rank]
                        intersection[_LISTED_ROWS] = max(first - top, 0) << 8 | min(end - top, TILE_HEIGHT)
                    found += 1
        slots[order[rank], SLOTS_COUNT] = found - before
    return found


@parallel_kernel
def _list_intersections(
    splats: np.ndarray,
    order: np.ndarray,
    width: int,
    height: int,
    threads: int,
    slots: np.ndarray,
    counts: np.ndarray,
    listed: np.ndarray,
    found: np.ndarray,
) -> None:
    """List the intersections of each share of `order`."""
    shares = len(counts)
    counter = first_piece()
    for _ in prange(threads):
        share = take(counter)
        while share < shares:
            own = counts[share]
            own[:] = 0
            first, end = share * len(order) // shares, (share + 1) * len(order) // shares
            found[share] = _list_range(splats, order, first, end, width, height, slots, own, listed[share])
            share = take(counter)


@kernel
def _place(counts: np.ndarray, ranges: np.ndarray) -> None:
    """Convert counts by share and tile to the start of each share's part of each tile's list."""
    place = 0
    for tile in range(counts.shape[1]):
        ranges[tile] = place
        for share in range(counts.shape[0]):
            count = counts[share, tile]
            counts[share, tile] = place
            place += count
    ranges[counts.shape[1]] = place


@kernel
def _number_slots(visible: np.ndarray, slots: np.ndarray) -> None:
    """Number the Gaussians' slots consecutively."""
    place = 0
    for i in visible:
        slots[i, SLOTS_FIRST] = place
        place += slots[i, SLOTS_COUNT]


@parallel_kernel
def _distribute(
    listed: np.ndarray,
    found: np.ndarray,
    places: np.ndarray,
    threads: int,
    slots: np.ndarray,
    intersections: np.ndarray,
) -> None:
    """Move the listed intersections to their tiles."""
    shares = len(found)
    counter = first_piece()
    for _ in prange(threads):
        share = take(counter)
        while share < shares:
            place = places[share]
            splat, slot = -1, 0
            for index in range(found[share]):
                intersection = intersections[place[listed[share, index, _LISTED_TILE]]]
                place[listed[share, index, _LISTED_TILE]] += 1
                if listed[share, index, _LISTED_SPLAT] != splat:
                    splat = listed[share, index, _LISTED_SPLAT]
                    slot = slots[splat, SLOTS_FIRST]
                intersection[INTERSECTION_SPLAT] = splat
                intersection[INTERSECTION_SLOT] = slot
                intersection[INTERSECTION_ROWS] = listed[share, index, _LISTED_ROWS]
                slot += 1
            share = take(counter)


def with_slack(count: int | np.integer) -> int:
    """Room for a quarter more, so that the next image probably fits too; beyond int32, which counts may be of."""
    return int(count) * 5 // 4


class Binner:
    """Makes tile lists, and keeps working memory between images.

    Args:
        threads: number of threads. The lists do not depend on it: each share is a run of the splats in depth order, and
            a tile's list concatenates the parts of the shares.
    """

    def __init__(self, threads: int) -> None:
        self._threads, shares = threads, SHARES_PER_THREAD * threads
        self._listed = np.empty((shares, (1 << 14) // SHARES_PER_THREAD, 3), np.int32)
        self._intersections = np.empty((1 << 14, INTERSECTION_FIELDS), np.int32)
        self._slots = np.empty((0, 2), np.int32)

    @property
    def nbytes(self) -> int:
        """Bytes of working memory."""
        return self._listed.nbytes + self._intersections.nbytes + self._slots.nbytes

    def bin(self, splats: np.ndarray, visible: np.ndarray, order: np.ndarray, view: View) -> TileLists:
        """Make the tile lists of one image.

        Args:
            splats: (N, SPLAT_FIELDS) from `project`.
            visible: (V,) int32 visible splats, in memory order.
            order: (V,) int32 visible splats, nearest first.
            view: the camera.
        """
        shares = len(self._listed)
        if len(self._slots) < len(splats):
            self._slots = np.empty((len(splats), 2), np.int32)
        slots = self._slots
        counts, found = np.empty((shares, view.tiles), np.int32), np.empty(shares, np.int64)
        size = (view.width, view.height, self._threads)
        _list_intersections(splats, order, *size, slots, counts, self._listed, found)
        if found.max() > self._listed.shape[1]:
            self._listed = np.empty((shares, with_slack(found.max()), 3), np.int32)
            _list_intersections(splats, order, *size, slots, counts, self._listed, found)
        ranges = np.empty(view.tiles + 1, np.int32)
        _place(counts, ranges)
        # Kept as well: fresh memory costs a page fault every 4 KB.
        if len(self._intersections) < ranges[-1]:
            self._intersections = np.empty((with_slack(ranges[-1]), INTERSECTION_FIELDS), np.int32)
        intersections = self._intersections[: ranges[-1]]
        _number_slots(visible, slots)
        _distribute(self._listed, found, counts, self._threads, slots, intersections)
        return TileLists(intersections, ranges, slots)
