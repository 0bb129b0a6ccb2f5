"""Local image detail."""

from __future__ import annotations

import cv2
import numpy as np

DETAIL_SCALE = 1.0
"""Standard deviation of the window in pixels, and the scale of fine detail: what one Gaussian can represent."""


def detail(image: np.ndarray) -> np.ndarray:
    """Local contrast: RMS, over a Gaussian window, of the difference from the image blurred with that window.

    Args:
        image: (H, W, 3) uint8.

    Returns:
        (H, W) float32 in [0, 1]; 0 where brightness is constant.
    """
    brightness = image.astype(np.float32).mean(axis=2) / np.float32(255)
    fine = brightness - _blurred(brightness)
    return np.sqrt(_blurred(fine * fine))


def _blurred(values: np.ndarray) -> np.ndarray:
    return cv2.GaussianBlur(values, (0, 0), DETAIL_SCALE)
