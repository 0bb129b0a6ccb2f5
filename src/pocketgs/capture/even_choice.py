"""Choosing some of many, evenly."""

from __future__ import annotations

import numpy as np


def evenly_chosen(count: int, most: int) -> np.ndarray:
    """(min(count, most),) int64 indices below `count`, ascending and evenly spaced from the first to the last."""
    return np.linspace(0, count - 1, min(count, most)).astype(np.int64)
