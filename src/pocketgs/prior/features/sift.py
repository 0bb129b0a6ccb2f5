"""Image features and their matches: SIFT from OpenCV."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from pocketgs.capture.capture import Frame
from pocketgs.system.compile import unlocked_kernel

CONTRAST = 0.015
"""SIFT's contrast threshold; lower than usual, since phones blur and geometric verification removes wrong matches."""

RATIO = 0.85
"""Ratio test: maximum distance of the best match relative to the second best (Lowe 2004, section 7.1)."""


@dataclass(frozen=True)
class Features:
    """The features of one image.

    Attributes:
        pixels: (N, 2) float64 positions; the centre of the top left pixel is (0.5, 0.5).
        descriptors: (N, 128) float32 of length 1.
        grain: side of a pixel of the image used for detection, in pixels of the frame that `pixels` refers to.
    """

    pixels: np.ndarray
    descriptors: np.ndarray
    grain: float = 1.0

    def select(self, chosen: np.ndarray) -> Features:
        """The features selected by a boolean mask or an index array."""
        return Features(self.pixels[chosen], self.descriptors[chosen], self.grain)


def detect(frame: Frame, most: int) -> Features:
    """Detect features in the pixels that mask and alpha leave.

    Descriptors are RootSIFT (Arandjelović and Zisserman 2012).

    Args:
        frame: the photograph.
        most: maximum number of features, the strongest.
    """
    grey = cv2.cvtColor(frame.image, cv2.COLOR_RGB2GRAY)
    # Without precise upscaling, features and with them refined poses are off by a quarter of a pixel.
    detector = cv2.SIFT.create(nfeatures=most, contrastThreshold=CONTRAST, enable_precise_upscale=True)
    usable = None if frame.usable is None else frame.usable.astype(np.uint8)
    keypoints, descriptors = detector.detectAndCompute(grey, usable)
    if descriptors is None:
        return Features(np.zeros((0, 2)), np.zeros((0, 128), np.float32))
    shares = descriptors / np.maximum(descriptors.sum(axis=1, keepdims=True), 1e-9)
    pixels = np.array([keypoint.pt for keypoint in keypoints]) + 0.5
    return Features(pixels, np.sqrt(shares).astype(np.float32))


def match(first: Features, second: Features) -> np.ndarray:
    """Match features that are mutual nearest neighbours and pass the ratio test.

    Returns:
        (M, 2) int64 indices into `first` and `second`.
    """
    if min(len(first.pixels), len(second.pixels)) < 2:
        return np.zeros((0, 2), np.int64)
    # Descriptors have length 1, so distances follow from dot products: d² = 2 - 2 p.
    forwards, best, second_best, backwards = _nearest(first.descriptors @ second.descriptors.T)
    mutual = backwards[forwards] == np.arange(len(forwards))
    rows = np.flatnonzero(mutual & (2 - 2 * best < RATIO**2 * (2 - 2 * second_best)))
    return np.stack([rows, forwards[rows]], axis=1)


@unlocked_kernel
def _nearest(products: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """For each row the column of the largest product, that product and the next; for each column the row."""
    rows, columns = products.shape
    forwards, backwards = np.zeros(rows, np.int64), np.zeros(columns, np.int64)
    best, second_best = np.full(rows, np.float32(-2)), np.full(rows, np.float32(-2))
    best_of_column = np.full(columns, np.float32(-2))
    for row in range(rows):
        largest, next_largest, at = np.float32(-2), np.float32(-2), 0
        for column in range(columns):
            product = products[row, column]
            if product > next_largest:
                if product > largest:
                    largest, next_largest, at = product, largest, column
                else:
                    next_largest = product
            if product > best_of_column[column]:
                best_of_column[column] = product
                backwards[column] = row
        forwards[row], best[row], second_best[row] = at, largest, next_largest
    return forwards, best, second_best, backwards
