"""The arrays that projection writes, one row per Gaussian."""

from __future__ import annotations

import numpy as np

from pocketgs.splat.cpu.layout import COLOURS, FIRST_CHANNEL


class SplatBuffers:
    """Projected splats, and space to order them.

    Args:
        count: number of Gaussians, N.
        channels: number of channels to composite, C.

    Attributes:
        splats: (N, FIRST_CHANNEL + C) float32, see `cpu/layout.py`; those of visible Gaussians are valid.
        depth_keys: (N,) uint32 from `project`.
        orders: (3, N) int32: space for the last three arguments of `sort_by_depth`.
    """

    def __init__(self, count: int, channels: int = COLOURS) -> None:
        self.splats = np.zeros((count, FIRST_CHANNEL + channels), np.float32)
        self.depth_keys = np.zeros(count, np.uint32)
        self.orders = np.zeros((3, count), np.int32)

    @property
    def nbytes(self) -> int:
        """Bytes of the arrays."""
        return self.splats.nbytes + self.depth_keys.nbytes + self.orders.nbytes
