"""The ellipse that a projected Gaussian covers."""

from __future__ import annotations

import math

import numpy as np

from pocketgs.splat.constants import ALPHA_MIN


def half_sizes(log2_opacities: np.ndarray, exponents: np.ndarray) -> np.ndarray:
    """(V, 2) half widths and heights of the ellipses of α = 1/255, in pixels.

    Args:
        log2_opacities: (V,).
        exponents: (V, 3) coefficients of dx², dx dy and dy², to base 2.
    """
    a, b, c = exponents.T
    reach = np.maximum(log2_opacities - np.float32(math.log2(ALPHA_MIN)), 0.0)
    factor = -4.0 * reach / (4.0 * a * c - b * b)
    return np.sqrt(np.stack([factor * c, factor * a], axis=1))
