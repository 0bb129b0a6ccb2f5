"""Choosing some of many views, evenly."""

from __future__ import annotations

import numpy as np


def evenly_chosen(views: int, most: int) -> np.ndarray:
    """Indices of at most `most` views, ascending and evenly spaced from the first to the last."""
    return np.unique(np.linspace(0, views - 1, min(views, most)).round().astype(int))
