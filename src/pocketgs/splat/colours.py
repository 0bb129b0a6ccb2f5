"""An affine transform of RGB for each training photograph: what its exposure and white balance make of the scene.

The loss compares a photograph with A c + b of each rendered colour c. A table holds a row for each photograph: A and b
as their difference from the identity, Adam's moments of these twelve numbers, and how often they have been updated.
The mean of all photographs' transforms is held at the identity, so that the scene is in the mean exposure.
"""

from __future__ import annotations

import numpy as np

from pocketgs.errors import PocketGSError

CHANGE = slice(0, 12)
"""Columns of (3, 4) A − I and b, by rows."""

FIRST_MOMENTS, SECOND_MOMENTS = slice(12, 24), slice(24, 36)
UPDATES = 36
COLUMNS = 37


def no_transforms(photographs: int) -> np.ndarray:
    """(V, COLUMNS) float32: the identity for each photograph, never updated."""
    return np.zeros((photographs, COLUMNS), np.float32)


def transforms_of(table: np.ndarray) -> np.ndarray:
    """(V, 3, 4) float64: [A | b] of each photograph."""
    return table[:, CHANGE].reshape(-1, 3, 4).astype(np.float64) + np.eye(3, 4)


def check_transforms(table: np.ndarray, photographs: int) -> None:
    """Refuse a table that does not belong to the photographs.

    Raises:
        PocketGSError: it is of another shape or type, or holds what is no number.
    """
    expected = (photographs, COLUMNS)
    if table.shape != expected or table.dtype != np.float32:
        found = f"{table.dtype} {table.shape}"
        raise PocketGSError(f"colour transforms are {found}, expected float32 {expected}, a row for each photograph")
    if not np.isfinite(table).all():
        raise PocketGSError("colour transforms hold NaN or infinity, expected finite numbers")
