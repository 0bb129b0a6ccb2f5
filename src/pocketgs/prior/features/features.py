"""Image features: positions and descriptors, and which of two images' features match."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from pocketgs.capture.capture import Frame

DESCRIPTOR = 128
"""Numbers of a descriptor."""

CONTRAST = 0.015
"""SIFT's contrast threshold; lower than usual, since phones blur and geometric verification removes wrong matches."""

RATIO = 0.85
"""Ratio test: maximum distance of the best match relative to the second best (Lowe 2004, section 7.1)."""


@dataclass(frozen=True)
class Features:
    """The features of one image.

    Attributes:
        pixels: (N, 2) float64 positions; the centre of the top left pixel is (0.5, 0.5).
        descriptors: (N, 128) float32 of length 1: RootSIFT (Arandjelović and Zisserman 2012).
        grain: side of a pixel of the image used for detection, in pixels of the frame that `pixels` refers to.
    """

    pixels: np.ndarray
    descriptors: np.ndarray
    grain: float = 1.0

    @staticmethod
    def none() -> Features:
        """No features."""
        return Features(np.zeros((0, 2)), np.zeros((0, DESCRIPTOR), np.float32))

    def select(self, chosen: np.ndarray) -> Features:
        """The features selected by a boolean mask or an index array."""
        return Features(self.pixels[chosen], self.descriptors[chosen], self.grain)


class Nearest(NamedTuple):
    """For each of N descriptors the nearest of another image's.

    Attributes:
        number: (N,) its index, of equally near ones the first.
        product: (N,) float32 dot product with it.
        next_product: (N,) float32 dot product with the second nearest.
    """

    number: np.ndarray
    product: np.ndarray
    next_product: np.ndarray


def mutual_matches(forwards: Nearest, backwards: np.ndarray) -> np.ndarray:
    """Match features that are mutual nearest neighbours and pass the ratio test.

    Args:
        forwards: for each feature of the first image the nearest of the second.
        backwards: for each of the second the index of the nearest of the first.

    Returns:
        (M, 2) int64 indices into the first and the second, sorted.
    """
    # Descriptors have length 1, so distances follow from dot products: d² = 2 - 2 p.
    mutual = backwards[forwards.number] == np.arange(len(forwards.number))
    passes = 2 - 2 * forwards.product < RATIO**2 * (2 - 2 * forwards.next_product)
    rows = np.flatnonzero(mutual & passes)
    return np.stack([rows, forwards.number[rows]], axis=1).astype(np.int64)


def unmasked(frame: Frame, pixels: np.ndarray) -> np.ndarray:
    """(N,) bool: which positions lie on pixels that mask and alpha leave."""
    if frame.usable is None:
        return np.ones(len(pixels), bool)
    height, width = frame.usable.shape
    columns, rows = np.clip(pixels.astype(np.int64), 0, (width - 1, height - 1)).T
    return np.asarray(frame.usable[rows, columns])
