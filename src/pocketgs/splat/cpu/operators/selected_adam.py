"""Adam on the rows of one array that are visible in a view."""

from __future__ import annotations

import numpy as np
from numba import prange

from pocketgs.system.compile import parallel_kernel
from pocketgs.system.dealing import PIECE, first_piece, take


@parallel_kernel
def adam_of_rows(
    values: np.ndarray,
    gradients: np.ndarray,
    first_moments: np.ndarray,
    second_moments: np.ndarray,
    seen: np.ndarray,
    rate: float,
    decay1: float,
    decay2: float,
    epsilon: float,
    threads: int,
) -> None:
    """One step of Adam without bias correction, in place; rows that are not visible stay unchanged.

    Args:
        values: (N, M) float32, updated.
        gradients: (N, M) float32.
        first_moments: (N, M) float32, updated.
        second_moments: (N, M) float32, updated.
        seen: (N,) bool, visible rows.
        rate: learning rate.
        decay1: β₁.
        decay2: β₂.
        epsilon: ε.
        threads: number of threads.
    """
    keep1, take1 = np.float32(decay1), np.float32(1.0 - decay1)
    keep2, take2 = np.float32(decay2), np.float32(1.0 - decay2)
    step, guard = np.float32(rate), np.float32(epsilon)
    counter = first_piece()
    for _ in prange(threads):
        first = PIECE * take(counter)
        while first < len(values):
            for i in range(first, min(first + PIECE, len(values))):
                if seen[i]:
                    for c in range(values.shape[1]):
                        g = gradients[i, c]
                        mean = keep1 * first_moments[i, c] + take1 * g
                        square = keep2 * second_moments[i, c] + take2 * g * g
                        first_moments[i, c], second_moments[i, c] = mean, square
                        values[i, c] -= step * mean / (np.sqrt(square) + guard)
            first = PIECE * take(counter)
