"""Splat-pixel pairs of the CPU engine: one splat at one pixel.

Visited pairs are those that a vector of 16 pixels covers; contributing ones have an alpha of at least 1/255 at a pixel
that is not saturated.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from pocketgs.geometry.camera import Camera
from pocketgs.splat.constants import ALPHA_MAX, TRANSMITTANCE_MIN
from pocketgs.splat.cpu.bin import TileLists
from pocketgs.splat.cpu.engine import CpuEngine
from pocketgs.splat.cpu.layout import (
    INTERSECTION_ROWS,
    INTERSECTION_SPLAT,
    LOG2_ALPHA_MIN,
    TILE_HEIGHT,
    TILE_WIDTH,
    View,
    tiles_down,
)
from pocketgs.splat.cpu.lenses.lens import kernel_lens
from pocketgs.splat.cpu.tile_image import TileImage


def count_pairs(engine: CpuEngine, camera: Camera) -> tuple[int, int]:
    """Visited and contributing pairs of one view of the engine's scene."""
    return _walk(*_drawn(engine, camera), np.empty((0, 2), np.int64))


def list_pairs(engine: CpuEngine, camera: Camera) -> np.ndarray:
    """(P, 2) int64 splat and pixel of every contributing pair of one view, each tile's front to back."""
    drawn = _drawn(engine, camera)
    _, contributing = _walk(*drawn, np.empty((0, 2), np.int64))
    places = np.empty((contributing, 2), np.int64)
    _walk(*drawn, places)
    return places


def _drawn(engine: CpuEngine, camera: Camera) -> tuple[np.ndarray, TileLists, TileImage]:
    """Results of the engine's forward pass: splats, tile lists and the image."""
    forward = engine._forward(View.of(camera), kernel_lens(camera), np.zeros(3, np.float32))
    return engine._buffers.splats, forward.lists, forward.canvas.drawn


@njit
def _walk(splats: np.ndarray, lists: TileLists, drawn: TileImage, places: np.ndarray) -> tuple[int, int]:
    """Number of visited and contributing pairs; writes the first of the latter to `places`, as many as it holds."""
    height, width = drawn.transmittance.shape
    visited, contributing = 0, 0
    transmittance = np.empty((TILE_HEIGHT, TILE_WIDTH))
    for tile in range(len(drawn.drawn_ends)):
        left, top = tile // tiles_down(height) * TILE_WIDTH, tile % tiles_down(height) * TILE_HEIGHT
        transmittance[:] = 1.0
        for index in range(lists.ranges[tile], drawn.drawn_ends[tile]):
            intersection = lists.intersections[index]
            splat, rows = intersection[INTERSECTION_SPLAT], intersection[INTERSECTION_ROWS]
            x, y, xx, xy, yy, log2_opacity = splats[splat][:6]
            for row in range((rows >> 8) // 2 * 2, ((rows & 255) + 1) // 2 * 2):
                for column in range(TILE_WIDTH):
                    visited += 1
                    dx, dy = left + column + 0.5 - x, top + row + 0.5 - y
                    exponent = log2_opacity + xx * dx * dx + xy * dx * dy + yy * dy * dy
                    inside = left + column < width and top + row < height
                    if inside and exponent >= LOG2_ALPHA_MIN and transmittance[row, column] >= TRANSMITTANCE_MIN:
                        if contributing < len(places):
                            places[contributing, 0] = splat
                            places[contributing, 1] = (top + row) * width + left + column
                        contributing += 1
                        transmittance[row, column] *= 1.0 - min(2.0**exponent, ALPHA_MAX)
    return visited, contributing
