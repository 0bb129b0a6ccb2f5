"""Rows of the rendered image and its photograph, for the losses."""

from __future__ import annotations

import numpy as np

from pocketgs.splat.cpu.lanes import LANES, broadcast, load, store
from pocketgs.system.compile import part


@part
def read_row(rendered: np.ndarray, photo: np.ndarray, mask: np.ndarray, row: int, x: np.ndarray, y: np.ndarray) -> None:
    """Read a row of both images as floats; outside the mask the photograph is replaced by the rendering."""
    for column in range(len(rendered[row])):
        x[column] = rendered[row, column]
        y[column] = np.float32(photo[row, column]) * np.float32(1.0 / 255.0)
    if mask.shape[0] > 0:
        for column in range(len(rendered[row])):
            if not mask[row, column]:
                y[column] = x[column]


@part
def row_sum(row: np.ndarray) -> float:
    """Sum of a row that consists of whole vectors, lane by lane first."""
    total = broadcast(np.float32(0.0))
    for column in range(0, len(row), LANES):
        total = total + load(row, column)
    lanes = np.empty(LANES, np.float32)
    store(lanes, 0, total)
    return lanes.sum()
