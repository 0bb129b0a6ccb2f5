"""The background colour."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np

from pocketgs.errors import PocketGSError

Background: TypeAlias = tuple[float, float, float]
"""Red, green and blue in [0, 1]."""

BLACK: Background = (0.0, 0.0, 0.0)


def checked_background(found: object) -> Background:
    """Check a background colour and convert it to floats.

    Raises:
        PocketGSError: it is not three numbers from 0 to 1.
    """
    try:
        colour = np.asarray(found, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        colour = np.empty(0)
    if colour.shape != (3,) or isinstance(found, str) or not np.all((colour >= 0.0) & (colour <= 1.0)):
        raise PocketGSError(f"background: found {found!r}, expected three numbers from 0 to 1")
    red, green, blue = colour.tolist()
    return (red, green, blue)
