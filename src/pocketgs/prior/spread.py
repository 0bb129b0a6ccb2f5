"""Choosing some of many, evenly."""

from __future__ import annotations

import numpy as np


def spread(count: int, most: int) -> np.ndarray:
    """(min(count, most),) int64 indices below `count`, evenly spaced."""
    return np.linspace(0, count - 1, min(most, count)).astype(np.int64)
