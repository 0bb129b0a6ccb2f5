"""The image that tiles are drawn to, and copying of tiles to and from images."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pocketgs.splat.cpu.layout import TILE_HEIGHT, TILE_PIXELS, TILE_WIDTH, View
from pocketgs.splat.cpu.tile import origin
from pocketgs.system.compile import part


class TileImage(NamedTuple):
    """An image that is drawn tile by tile.

    Write only in a function that the `prange` loop calls; see `SceneArrays`.

    Attributes:
        image: (C, H, W) float32 over the background.
        transmittance: (H, W) float32, fraction of the background that shows through.
        drawn_ends: (tiles,) int32, one past the last intersection drawn before the tile saturated.
    """

    image: np.ndarray
    transmittance: np.ndarray
    drawn_ends: np.ndarray

    @staticmethod
    def empty(view: View, channels: int) -> TileImage:
        """An image to be drawn."""
        shape = (view.height, view.width)
        image, transmittance = np.empty((channels, *shape), np.float32), np.empty(shape, np.float32)
        return TileImage(image, transmittance, np.empty(view.tiles, np.int32))


@part
def write_over(
    tile: int, end: int, background: np.ndarray, transmittance: np.ndarray, colours: np.ndarray, drawn: TileImage
) -> None:
    """Copy a finished tile to the images of transmittance and channels, blended over the background.

    Args:
        tile: number of the tile.
        end: one past the last intersection drawn.
        background: (C,) float32.
        transmittance: (TILE_PIXELS,) float32 of the tile.
        colours: (C · TILE_PIXELS,) float32 of the tile, overwritten.
        drawn: written.
    """
    drawn.drawn_ends[tile] = end
    left, top = origin(tile, drawn.image.shape[1])
    write_tile(transmittance, left, top, drawn.transmittance)
    for channel in range(drawn.image.shape[0]):
        plane = colours[channel * TILE_PIXELS : (channel + 1) * TILE_PIXELS]
        for pixel in range(TILE_PIXELS):
            plane[pixel] += transmittance[pixel] * background[channel]
        write_tile(plane, left, top, drawn.image[channel])


@part
def write_tile(tile_pixels: np.ndarray, left: int, top: int, image: np.ndarray) -> None:
    """Copy the part of a tile inside the image to it."""
    for row in range(min(TILE_HEIGHT, image.shape[0] - top)):
        for column in range(min(TILE_WIDTH, image.shape[1] - left)):
            image[top + row, left + column] = tile_pixels[row * TILE_WIDTH + column]


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
