"""The scene's parameters as the shaders hold them: column by column, see `shaders/common/gaussians.wgsl`."""

from __future__ import annotations

import numpy as np

from pocketgs.scene.formats.activations import finite_log_scales
from pocketgs.scene.gaussians import Gaussians


def transposed(rows: np.ndarray) -> np.ndarray:
    """Columns for rows, and the other way round, contiguous."""
    return np.ascontiguousarray(rows.T, np.float32)


def to_columns(scene: Gaussians) -> tuple[np.ndarray, np.ndarray]:
    """Pack a scene.

    Returns:
        `shape`, (11, N) float32: mean 3, log scale 3, which is finite for a scale of 0, quaternion of unit length 4,
        opacity logit 1; and `sh`, (3 K, N) float32.
    """
    log_scales = finite_log_scales(scene.log_scales)
    parts = [scene.means, log_scales, scene.unit_quaternions, scene.opacity_logits[:, None]]
    shape = np.concatenate([part.T for part in parts]).astype(np.float32)
    return shape, transposed(scene.sh.reshape(len(scene), 3 * scene.sh.shape[1]))


def from_columns(shape: np.ndarray, sh: np.ndarray) -> Gaussians:
    """Unpack what `to_columns` packs."""
    rows = transposed(shape)
    return Gaussians(
        rows[:, :3], rows[:, 3:6], rows[:, 6:10], rows[:, 10], transposed(sh).reshape(len(rows), len(sh) // 3, 3)
    )
