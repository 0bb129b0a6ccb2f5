"""Work that threads take piece by piece."""

from __future__ import annotations

import numba
import numpy as np
import pytest
from numba import prange

from pocketgs.system.dealing import first_piece, take


@numba.njit(parallel=True)
def take_all(pieces: int, threads: int, taken: np.ndarray) -> None:
    counter = first_piece()
    for _ in prange(threads):
        piece = take(counter)
        while piece < pieces:
            taken[piece] += 1
            piece = take(counter)


@pytest.mark.parametrize(("pieces", "threads"), [(0, 2), (1, 4), (1000, 1), (100_000, 2), (100_000, 7)])
def test_every_piece_is_taken_once(pieces: int, threads: int) -> None:
    taken = np.zeros(pieces, np.int64)
    take_all(pieces, threads, taken)
    np.testing.assert_array_equal(taken, 1)
