"""How much there is to see in the surroundings of each pixel."""

from __future__ import annotations

import cv2
import numpy as np

DETAIL_SCALE = 1.0
"""Standard deviation in pixels of the window, and of what counts as fine: the scale of what one Gaussian can show."""


def detail(image: np.ndarray) -> np.ndarray:
    """Local contrast: the root mean square, over a Gaussian window, of what blurring with that window takes away.

    Args:
        image: (H, W, 3) uint8.

    Returns:
        (H, W) float32 in [0, 1]; 0 where the surroundings are of one brightness.
    """
    brightness = image.astype(np.float32).mean(axis=2) / np.float32(255)
    fine = brightness - _blurred(brightness)
    return np.sqrt(_blurred(fine * fine))


def _blurred(values: np.ndarray) -> np.ndarray:
    return cv2.GaussianBlur(values, (0, 0), DETAIL_SCALE)
