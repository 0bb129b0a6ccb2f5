"""Statistics per Gaussian from the backward pass, for densification strategies."""

from __future__ import annotations

import math

import numpy as np

from pocketgs.splat.constants import RADIUS_SIGMAS
from pocketgs.splat.cpu.layout import EXPONENT_XX, EXPONENT_XY, EXPONENT_YY, View
from pocketgs.system.compile import inlined

SCREEN_GRADIENT, SEEN, RADIUS = range(3)
STATISTICS = 3
"""Columns of the sums, one row per Gaussian."""

_LN2 = math.log(2.0)


@inlined
def collect(view: View, splat: np.ndarray, d_mean: tuple[float, float], sums: np.ndarray) -> None:
    """Add one view of a Gaussian to its sums.

    Args:
        view: the camera.
        splat: (SPLAT_FIELDS,) from `project`.
        d_mean: gradient of the loss with respect to the projected centre, in pixels.
        sums: (STATISTICS,) float32, updated.
    """
    # In half the image's width and height.
    x, y = d_mean[0] * 0.5 * view.width, d_mean[1] * 0.5 * view.height
    sums[SCREEN_GRADIENT] += math.sqrt(x * x + y * y)
    sums[SEEN] += 1.0
    # The larger variance is one over the lesser eigenvalue of Σ'⁻¹.
    xx, xy, yy = -2.0 * _LN2 * splat[EXPONENT_XX], -_LN2 * splat[EXPONENT_XY], -2.0 * _LN2 * splat[EXPONENT_YY]
    middle, half = 0.5 * (xx + yy), math.sqrt(0.25 * (xx - yy) ** 2 + xy * xy)
    least = max(middle - half, 1e-12)
    radius = RADIUS_SIGMAS / math.sqrt(least) / max(view.width, view.height)
    sums[RADIUS] = max(sums[RADIUS], radius)
