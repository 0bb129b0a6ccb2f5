"""Epipolar geometry of two views."""

from __future__ import annotations

import numpy as np


def essential_matrix(first_to_second: np.ndarray) -> np.ndarray:
    """(3, 3) essential matrix E of two cameras: matching rays satisfy there @ E @ here = 0 (Longuet-Higgins 1981).

    Args:
        first_to_second: (4, 4) or (3, 4) rigid transform from the first camera to the second.
    """
    x, y, z = first_to_second[:3, 3]
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return cross @ first_to_second[:3, :3]


def sampson_distances(matrix: np.ndarray, here: np.ndarray, there: np.ndarray) -> np.ndarray:
    """(M,) Sampson distance of matches from an epipolar geometry, in the unit of the points (Sampson 1982).

    Args:
        matrix: (3, 3) fundamental matrix for pixels, or essential matrix for points at depth 1.
        here: (M, 2) points in the first image.
        there: (M, 2) points in the second.
    """
    one, other = (np.column_stack([points, np.ones(len(points))]) for points in (here, there))
    lines, other_lines = one @ matrix.T, other @ matrix
    slope = np.sum(lines[:, :2] ** 2 + other_lines[:, :2] ** 2, axis=1)
    return np.abs(np.sum(lines * other, axis=1)) / np.sqrt(np.maximum(slope, 1e-30))
