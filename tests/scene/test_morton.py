"""Morton order: neighbours in space are neighbours in memory."""

from __future__ import annotations

import numpy as np

from pocketgs.scene.morton import morton_order


def test_bits_are_interleaved() -> None:
    points = np.random.default_rng(0).uniform(-5, 9, (300, 3)).astype(np.float32)
    low, high = np.quantile(points, [0.01, 0.99], axis=0)
    side = 2 * (high - low).max()
    cells = ((points.astype(np.float64) - low + side / 4) / side * (2**21 - 1)).astype(np.int64)

    def code(cell: np.ndarray) -> int:
        return sum((int(cell[axis]) >> bit & 1) << (3 * bit + axis) for bit in range(21) for axis in range(3))

    codes = [code(cell) for cell in cells]
    assert morton_order(points).tolist() == sorted(range(300), key=codes.__getitem__)


def test_what_is_not_finite_comes_last() -> None:
    points = np.array([[np.nan, 0, 0], [1, 1, 1], [0, np.inf, 0], [0, 0, 0]], np.float32)
    assert morton_order(points).tolist() == [3, 1, 0, 2]
