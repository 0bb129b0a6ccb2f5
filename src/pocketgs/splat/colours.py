"""Affine colour transforms of the training photographs, for differences in exposure and white balance.

The loss compares a photograph with A c + b of each rendered colour c. A table has one row per photograph: the
difference of A and b from the identity, Adam's moments of these twelve numbers, and the number of updates. The mean of
all transforms is kept at the identity, so that the scene has the mean exposure.
"""

from __future__ import annotations

import numpy as np

from pocketgs.errors import PocketGSError

CHANGE = slice(0, 12)
"""Columns of the (3, 4) matrix [A − I | b], row by row."""

FIRST_MOMENTS, SECOND_MOMENTS = slice(12, 24), slice(24, 36)
UPDATES = 36
COLUMNS = 37


def no_transforms(photographs: int) -> np.ndarray:
    """(V, COLUMNS) float32: the identity for each photograph, without updates."""
    return np.zeros((photographs, COLUMNS), np.float32)


def transforms_of(table: np.ndarray) -> np.ndarray:
    """(V, 3, 4) float64: [A | b] of each photograph."""
    return table[:, CHANGE].reshape(-1, 3, 4).astype(np.float64) + np.eye(3, 4)


def check_transforms(table: np.ndarray, photographs: int) -> None:
    """Check that a table fits the photographs.

    Raises:
        PocketGSError: it has another shape or type, or contains NaN or infinity.
    """
    expected = (photographs, COLUMNS)
    if table.shape != expected or table.dtype != np.float32:
        found = f"{table.dtype} {table.shape}"
        raise PocketGSError(f"colour transforms are {found}, expected float32 {expected}, a row for each photograph")
    if not np.isfinite(table).all():
        raise PocketGSError("colour transforms hold NaN or infinity, expected finite numbers")
