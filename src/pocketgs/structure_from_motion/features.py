"""SIFT features for COLMAP, computed with OpenCV, four times as fast as COLMAP's own on a CPU.

They are computed outside COLMAP's process, since Pillow, which decodes the photographs, cannot share one with it: see
`colmap/job.py`.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

CONTRAST = 0.02
"""SIFT's contrast threshold, COLMAP's value."""


@dataclass(frozen=True)
class ImageFeatures:
    """The features of one image.

    Attributes:
        keypoints: (N, 4) float32: x, y with the top left corner at (0, 0), scale in pixels, direction in radians.
        descriptors: (N, 128) uint8, RootSIFT times 512 as COLMAP keeps it; strongest features first.
    """

    keypoints: np.ndarray
    descriptors: np.ndarray

    def within(self, mask: np.ndarray, size: tuple[int, int]) -> ImageFeatures:
        """The features inside an (H, W) bool mask of any size; `size` is the image's width and height."""
        scale = np.array(mask.shape[::-1]) / np.array(size)
        columns, rows = np.clip((self.keypoints[:, :2] * scale).astype(int), 0, np.array(mask.shape[::-1]) - 1).T
        kept = mask[rows, columns]
        return ImageFeatures(self.keypoints[kept], self.descriptors[kept])


def find_features(image: np.ndarray, most: int) -> ImageFeatures:
    """The `most` strongest SIFT features of an (H, W, 3) uint8 image, strongest first.

    Descriptors are RootSIFT (Arandjelović and Zisserman 2012).
    """
    grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    # Without precise upscaling, features are off by a quarter of a pixel.
    detector = cv2.SIFT.create(nfeatures=most, contrastThreshold=CONTRAST, enable_precise_upscale=True)
    found, descriptors = detector.detectAndCompute(grey, None)
    if descriptors is None:
        return ImageFeatures(np.zeros((0, 4), np.float32), np.zeros((0, 128), np.uint8))
    order = np.argsort([-keypoint.response for keypoint in found], kind="stable")
    keypoints = np.array([_row(found[index]) for index in order], np.float32)
    shares = descriptors[order] / np.maximum(descriptors[order].sum(axis=1, keepdims=True), 1e-9)
    return ImageFeatures(keypoints, np.clip(np.rint(512 * np.sqrt(shares)), 0, 255).astype(np.uint8))


def _row(keypoint: cv2.KeyPoint) -> tuple[float, float, float, float]:
    x, y = keypoint.pt  # OpenCV has pixel centres at integers
    return x + 0.5, y + 0.5, keypoint.size / 2, float(np.radians(keypoint.angle))
