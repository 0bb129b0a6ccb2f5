"""Tile lists from given intersections in gsplat's layout, in place of `Binner`."""

from __future__ import annotations

import numpy as np
from numba import prange

from pocketgs.splat.constants import CULLED
from pocketgs.splat.cpu.bin import TileLists, columns_reached, ellipse_of, rows_reached
from pocketgs.splat.cpu.layout import (
    INTERSECTION_FIELDS,
    INTERSECTION_ROWS,
    INTERSECTION_SLOT,
    INTERSECTION_SPLAT,
    SLOTS_COUNT,
    SLOTS_FIRST,
    TILE_HEIGHT,
    TILE_WIDTH,
    tiles_down,
)
from pocketgs.system.compile import kernel, parallel_kernel, part
from pocketgs.system.dealing import first_piece, take


@part
def _list_tile(
    tile: int,
    splats: np.ndarray,
    depth_keys: np.ndarray,
    given: np.ndarray,
    width: int,
    height: int,
    intersections: np.ndarray,
) -> int:
    """List the given splats that reach a tile, in the given order, as far as space allows; return their number."""
    down = tiles_down(height)
    column, top = tile // down, tile % down * TILE_HEIGHT
    found = 0
    for i in given:
        if depth_keys[i] == CULLED:
            continue
        ellipse = ellipse_of(splats[i])
        first_column, end_column = columns_reached(ellipse, width)
        if first_column <= column < end_column:
            first, end = rows_reached(ellipse, column, width, height)
            first, end = max(first - top, 0), min(end - top, TILE_HEIGHT)
            if first < end:
                if found < len(intersections):
                    intersections[found, INTERSECTION_SPLAT] = i
                    intersections[found, INTERSECTION_ROWS] = first << 8 | end
                found += 1
    return found


@parallel_kernel
def _list_tiles(
    splats: np.ndarray,
    depth_keys: np.ndarray,
    offsets: np.ndarray,
    given: np.ndarray,
    tile_size: int,
    width: int,
    height: int,
    ranges: np.ndarray,
    threads: int,
    counts: np.ndarray,
    intersections: np.ndarray,
) -> None:
    """List the splats of all tiles, each from the list of the given tile that contains it."""
    tiles, across, down = len(counts), -(-width // tile_size), tiles_down(height)
    counter = first_piece()
    for _ in prange(threads):
        tile = take(counter)
        while tile < tiles:
            parent = tile % down * TILE_HEIGHT // tile_size * across + tile // down * TILE_WIDTH // tile_size
            listed = given[offsets[parent] : offsets[parent + 1]]
            own = intersections[ranges[tile] : ranges[tile + 1]]
            counts[tile] = _list_tile(tile, splats, depth_keys, listed, width, height, own)
            tile = take(counter)


@kernel
def _number_slots(intersections: np.ndarray, slots: np.ndarray) -> None:
    """Number the splats' slots consecutively, so that each splat's are contiguous."""
    slots[:] = 0
    for index in range(len(intersections)):
        slots[intersections[index, INTERSECTION_SPLAT], SLOTS_COUNT] += 1
    place = 0
    for i in range(len(slots)):
        slots[i, SLOTS_FIRST] = place
        place += slots[i, SLOTS_COUNT]
        slots[i, SLOTS_COUNT] = 0
    for index in range(len(intersections)):
        own = slots[intersections[index, INTERSECTION_SPLAT]]
        intersections[index, INTERSECTION_SLOT] = own[SLOTS_FIRST] + own[SLOTS_COUNT]
        own[SLOTS_COUNT] += 1


def lists_from(
    splats: np.ndarray,
    depth_keys: np.ndarray,
    offsets: np.ndarray,
    given: np.ndarray,
    tile_size: int,
    size: tuple[int, int],
    threads: int,
) -> TileLists:
    """Make the tile lists of one image.

    Args:
        splats: (N, FIRST_CHANNEL + C) float32.
        depth_keys: (N,) uint32, CULLED for splats that are not drawn.
        offsets: (given tiles + 1,) int32, start of each given tile's list; tiles are numbered row by row.
        given: int32 splats, nearest first in each list.
        tile_size: side of a given tile, a multiple of both of our tiles' sides.
        size: width and height of the image.
        threads: number of threads.
    """
    width, height = size
    tiles = -(-width // TILE_WIDTH) * (-(-height // TILE_HEIGHT))
    counts, none = np.zeros(tiles, np.int32), np.zeros(tiles + 1, np.int32)
    numbers = (tile_size, width, height)
    empty = np.empty((0, INTERSECTION_FIELDS), np.int32)
    _list_tiles(splats, depth_keys, offsets, given, *numbers, none, threads, counts, empty)
    ranges = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
    intersections = np.empty((ranges[-1], INTERSECTION_FIELDS), np.int32)
    _list_tiles(splats, depth_keys, offsets, given, *numbers, ranges, threads, counts, intersections)
    slots = np.empty((len(splats), 2), np.int32)
    _number_slots(intersections, slots)
    return TileLists(intersections, ranges, slots)


@kernel
def list_intersections(
    first_tiles: np.ndarray,
    end_tiles: np.ndarray,
    images: np.ndarray,
    depth_bits: np.ndarray,
    across: int,
    tile_bits: int,
    intersection_ids: np.ndarray,
    splat_ids: np.ndarray,
) -> None:
    """Write gsplat's intersections: all tiles in the rectangle around each splat.

    Args:
        first_tiles: (N, 2) int64 column and row of the rectangle's first tile.
        end_tiles: (N, 2) int64, one past its last.
        images: (N,) int64, image of each splat.
        depth_bits: (N,) int64, the bits of the depth as a float32.
        across: number of tiles in a row.
        tile_bits: number of bits of a tile's index.
        intersection_ids: (E,) int64, written: image, tile, depth.
        splat_ids: (E,) int32, written.
    """
    place = 0
    for i in range(len(images)):
        for row in range(first_tiles[i, 1], end_tiles[i, 1]):
            for column in range(first_tiles[i, 0], end_tiles[i, 0]):
                tile = row * across + column
                intersection_ids[place] = ((images[i] << tile_bits | tile) << 32) | depth_bits[i]
                splat_ids[place] = i
                place += 1
