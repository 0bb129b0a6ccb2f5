"""Limits of compositing, in which otherwise equal rasterizers differ."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pocketgs.splat.constants import ALPHA_MAX


class Limits(NamedTuple):
    """Limits of compositing.

    Attributes:
        most_opaque: float32, maximum α of a splat on a pixel; a clamped α has no gradient.
        stops_before: whether a pixel skips the splat that would bring its transmittance below 1e-4, and all behind it,
            as 3DGS and gsplat do; otherwise that splat is the last one drawn.
    """

    most_opaque: float
    stops_before: bool


TRAINING = Limits(np.float32(ALPHA_MAX), False)
"""The limits of training, and of rendering its scenes."""

GSPLAT = Limits(np.float32(0.999), True)
"""The limits of gsplat."""
