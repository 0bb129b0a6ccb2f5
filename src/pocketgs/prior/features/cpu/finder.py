"""Features on the CPU."""

from __future__ import annotations

import sys

import cv2
import numpy as np

from pocketgs.capture.capture import Frame
from pocketgs.prior.features.features import CONTRAST, Features, Nearest, mutual_matches
from pocketgs.system.compile import unlocked_kernel
from pocketgs.system.device import DeviceName


class CpuFinder:
    """See `pocketgs.prior.features.finder.FeatureFinder`. SIFT is OpenCV's."""

    name: DeviceName = "cpu"
    most_pixels = sys.maxsize

    def detect(self, frame: Frame, most: int) -> Features:
        """Detect features."""
        grey = cv2.cvtColor(frame.image, cv2.COLOR_RGB2GRAY)
        # Without precise upscaling, features and with them refined poses are off by a quarter of a pixel.
        detector = cv2.SIFT.create(nfeatures=most, contrastThreshold=CONTRAST, enable_precise_upscale=True)
        usable = None if frame.usable is None else frame.usable.astype(np.uint8)
        keypoints, descriptors = detector.detectAndCompute(grey, usable)
        if descriptors is None:
            return Features.none()
        shares = descriptors / np.maximum(descriptors.sum(axis=1, keepdims=True), 1e-9)
        pixels = np.array([keypoint.pt for keypoint in keypoints]) + 0.5
        return Features(pixels, np.sqrt(shares).astype(np.float32))

    def match(self, first: Features, second: Features) -> np.ndarray:
        """Match features."""
        if min(len(first.pixels), len(second.pixels)) < 2:
            return np.zeros((0, 2), np.int64)
        number, product, next_product, backwards = _nearest(first.descriptors @ second.descriptors.T)
        return mutual_matches(Nearest(number, product, next_product), backwards)

    def release(self) -> None:
        """There is nothing to give back."""


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
