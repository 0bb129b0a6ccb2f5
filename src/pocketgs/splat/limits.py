"""Where compositing stops: the one thing in which rasterizers that else agree differ."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pocketgs.splat.constants import ALPHA_MAX


class Limits(NamedTuple):
    """Where compositing stops.

    Attributes:
        most_opaque: float32, the largest α of one splat on one pixel; where it is cut to that, it has no gradient.
        stops_before: whether a pixel leaves out the splat that would bring its transmittance to 1e-4, with all behind
            it, as 3DGS and gsplat do; otherwise that splat is the last one drawn.
    """

    most_opaque: float
    stops_before: bool


TRAINING = Limits(np.float32(ALPHA_MAX), False)
"""The limits of training and of whatever renders its scenes."""
