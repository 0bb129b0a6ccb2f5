"""Dropout: a training step leaves out a random share of the Gaussians."""

from __future__ import annotations

import numpy as np
from numba import prange

from pocketgs.splat.constants import CULLED
from pocketgs.splat.cpu.hash import pcg_hash
from pocketgs.system.compile import parallel_kernel
from pocketgs.system.dealing import PIECE, first_piece, take


@parallel_kernel
def drop_out(depth_keys: np.ndarray, threshold: int, seed: int, threads: int) -> None:
    """Cull a random choice of Gaussians after projection.

    Args:
        depth_keys: (N,) uint32 from `project`, set to CULLED for those left out.
        threshold: Gaussians are left out whose hash is below, see `Dropout.threshold`.
        seed: determines the choice, on any number of threads.
        threads: number of threads.
    """
    start = pcg_hash(seed & 0xFFFFFFFF)
    counter = first_piece()
    for _ in prange(threads):
        piece = PIECE * take(counter)
        while piece < len(depth_keys):
            for i in range(piece, min(piece + PIECE, len(depth_keys))):
                if pcg_hash(start ^ i) < threshold:
                    depth_keys[i] = CULLED
            piece = PIECE * take(counter)
