"""Features of photographs and their matches: SIFT, detected and described by OpenCV."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from pocketgs.capture.capture import Frame

CONTRAST = 0.015
"""SIFT's threshold; lower than usual, since phones blur and geometry weeds out what is wrong."""

RATIO = 0.85
"""The best match must be nearer than this times the second best (Lowe 2004, section 7.1)."""

VERIFICATION = 1.5
"""Distance in pixels from epipolar lines within which matches agree with one motion."""

FEWEST_MATCHES = 12
"""A pair with fewer that agree says nothing."""


@dataclass(frozen=True)
class Features:
    """Distinctive places of one image.

    Attributes:
        pixels: (N, 2) float64, the centre of the top left pixel being at (0.5, 0.5).
        descriptors: (N, 128) float32 of length 1.
    """

    pixels: np.ndarray
    descriptors: np.ndarray


def detect(frame: Frame, most: int) -> Features:
    """Find features away from what masks and alpha leave out.

    Descriptors are RootSIFT (Arandjelović and Zisserman 2012).

    Args:
        frame: the photograph.
        most: number of features to keep, the strongest.
    """
    grey = cv2.cvtColor(frame.image, cv2.COLOR_RGB2GRAY)
    # Without precise upscaling features lie a quarter of a pixel off, and refined poses with them.
    detector = cv2.SIFT.create(nfeatures=most, contrastThreshold=CONTRAST, enable_precise_upscale=True)
    usable = None if frame.usable is None else frame.usable.astype(np.uint8)
    keypoints, descriptors = detector.detectAndCompute(grey, usable)
    if descriptors is None:
        return Features(np.zeros((0, 2)), np.zeros((0, 128), np.float32))
    shares = descriptors / np.maximum(descriptors.sum(axis=1, keepdims=True), 1e-9)
    pixels = np.array([keypoint.pt for keypoint in keypoints]) + 0.5
    return Features(pixels, np.sqrt(shares).astype(np.float32))


def match(first: Features, second: Features) -> np.ndarray:
    """Pair features whose descriptors are each other's nearest, clearly nearer than the next.

    Returns:
        (M, 2) int64 indices into `first` and `second`.
    """
    if min(len(first.pixels), len(second.pixels)) < 2:
        return np.zeros((0, 2), np.int64)
    # Descriptors have length 1, so the distance falls as the product grows: d² = 2 - 2 p.
    products = first.descriptors @ second.descriptors.T
    forwards, backwards = products.argmax(axis=1), products.argmax(axis=0)
    rows = np.flatnonzero(backwards[forwards] == np.arange(len(forwards)))
    best = products[rows, forwards[rows]]
    products[rows, forwards[rows]] = -1.0
    second_best = products[rows].max(axis=1)
    clear = 2 - 2 * best < RATIO**2 * (2 - 2 * second_best)
    return np.stack([rows[clear], forwards[rows[clear]]], axis=1)


def agreeing(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Which matches one motion of the camera explains (a fundamental matrix, by RANSAC).

    Args:
        first: (M, 2) pixels in one view.
        second: (M, 2) pixels in the other.

    Returns:
        (M,) bool; all False where too few agree.
    """
    nothing = np.zeros(len(first), bool)
    if len(first) < FEWEST_MATCHES:
        return nothing
    cv2.setRNGSeed(0)
    _, inliers = cv2.findFundamentalMat(first, second, cv2.FM_RANSAC, VERIFICATION, 0.999, 1000)
    if inliers is None or inliers.sum() < FEWEST_MATCHES:
        return nothing
    return inliers.ravel() > 0
