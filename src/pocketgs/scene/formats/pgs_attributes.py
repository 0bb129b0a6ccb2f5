"""Columns of a `.pgs`'s attributes, and what is expected of each: reader and writer share this description."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pocketgs.scene.formats.pgs_columns import Columns
from pocketgs.system.compile import kernel

WINDOW = 16
"""Rows before a Gaussian's among which its neighbours are looked for."""

RED, GREEN, BLUE = 0, 1, 2
MAX_SIZE, MAX_FLATNESS, MAX_TILT = 127, 15, 7
"""Bounds of contexts: levels of y above the least, levels of y above z, and coarse steps of p."""


@dataclass(frozen=True)
class Surroundings:
    """Contexts for coding attributes, derived from positions.

    Attributes:
        neighbours: (N, 2) indices of the nearest two of the rows before each.
        coarseness: (N,) trailing zero bits of all three coordinates.
    """

    neighbours: np.ndarray
    coarseness: np.ndarray


def surroundings_of(cells: np.ndarray) -> Surroundings:
    """Derive contexts from (N, 3) cells in the order of the file."""
    together = cells[:, 0] | cells[:, 1] | cells[:, 2]
    lowest = together & -together
    coarseness = np.frexp(lowest.astype(np.float64))[1].astype(np.int64)
    return Surroundings(_nearest_before(np.ascontiguousarray(cells)), coarseness)


def code_scales(columns: Columns, table: np.ndarray, around: Surroundings) -> None:
    """Code (N, 3) levels of log scales."""
    y = columns.code(table[:, 1], around.coarseness)
    size = np.minimum(y - y.min(), MAX_SIZE)
    flatness = columns.code(table[:, 1] - table[:, 2], size)
    x = y - columns.code(table[:, 1] - table[:, 0], np.clip(flatness, -MAX_FLATNESS, MAX_FLATNESS) + MAX_FLATNESS)
    table[:] = np.stack([x, y, y - flatness], axis=1)


def code_turns(columns: Columns, table: np.ndarray, fineness: np.ndarray) -> None:
    """Code (N, 3) levels of rotations, whose steps have been halved (N, 3) times from the largest."""
    p = columns.code(table[:, 0], fineness[:, 0])
    tilt = np.minimum(np.abs(p) >> fineness[:, 0], MAX_TILT)
    r = columns.code(table[:, 1], fineness[:, 1] * (MAX_TILT + 1) + tilt)
    table[:] = np.stack([p, r, columns.code(table[:, 2], fineness[:, 2])], axis=1)


def code_opacities(columns: Columns, table: np.ndarray) -> None:
    """Code (N,) levels of opacity logits."""
    table[:] = columns.code(table, _no_context(table))


def code_colours(columns: Columns, table: np.ndarray, around: Surroundings) -> None:
    """Code (N, 3) levels of coefficients of degree 0: green, and how red and blue differ from it."""
    nothing = _no_context(table[:, 0])
    green = columns.code(table[:, GREEN], nothing, around.neighbours)
    red = green + columns.code(table[:, RED] - table[:, GREEN], nothing, around.neighbours)
    blue = green + columns.code(table[:, BLUE] - table[:, GREEN], nothing, around.neighbours)
    table[:] = np.stack([red, green, blue], axis=1)


def code_harmonics(columns: Columns, table: np.ndarray) -> None:
    """Code (N, K - 1, 3) levels of coefficients above degree 0, of a codebook's entries or of all Gaussians."""
    for place in range(table.shape[1]):
        green = columns.code(table[:, place, GREEN], _no_context(table))
        seen = np.minimum(np.abs(green), 2)
        red = columns.code(table[:, place, RED], seen)
        blue = columns.code(table[:, place, BLUE], seen + 3 * np.minimum(np.abs(red), 2))
        table[:, place] = np.stack([red, green, blue], axis=1)


def code_views(columns: Columns, table: np.ndarray) -> None:
    """Code (N, K) levels of the coefficients that weights depend on, without context: neighbours predict little."""
    for place in range(table.shape[1]):
        table[:, place] = columns.code(table[:, place], _no_context(table))


def code_labels(columns: Columns, table: np.ndarray) -> None:
    """Code (N,) indices of entries of the codebook."""
    table[:] = columns.code(table, _no_context(table))


def _no_context(like: np.ndarray) -> np.ndarray:
    return np.zeros(len(like), np.int64)


@kernel
def _nearest_before(cells: np.ndarray) -> np.ndarray:
    """(N, 2) indices of the nearest two of the `WINDOW` rows before each, the later of equal ones first.

    The second row has one neighbour twice, the first row none: -1.
    """
    found = np.full((len(cells), 2), -1)
    for index in range(1, len(cells)):
        best, second = np.inf, np.inf
        for other in range(index - 1, max(index - WINDOW, 0) - 1, -1):
            x = float(cells[index, 0] - cells[other, 0])
            y = float(cells[index, 1] - cells[other, 1])
            z = float(cells[index, 2] - cells[other, 2])
            apart = x * x + y * y + z * z
            if apart < best:
                second, found[index, 1] = best, found[index, 0]
                best, found[index, 0] = apart, other
            elif apart < second:
                second, found[index, 1] = apart, other
        if found[index, 1] < 0:
            found[index, 1] = found[index, 0]
    return found
