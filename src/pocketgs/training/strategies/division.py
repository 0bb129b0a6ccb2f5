"""One Gaussian becomes two: where they stand, and how large they are."""

from __future__ import annotations

import numpy as np

from pocketgs.geometry.quaternions import rotation_matrices
from pocketgs.scene.gaussians import Gaussians

SHRINKING = 1.6
"""Parts of a Gaussian that is split are smaller by this factor (3DGS, section 5.2)."""


def drawn_within(scene: Gaussians, rows: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(R, 3) points drawn from the Gaussians of those rows, in float32."""
    offsets = rng.standard_normal((len(rows), 3)) * np.exp(scene.log_scales[rows].astype(np.float64))
    turned = np.einsum("nij,nj->ni", axes_of(scene, rows), offsets)
    return (scene.means[rows] + turned).astype(np.float32)


def axes_of(scene: Gaussians, rows: np.ndarray) -> np.ndarray:
    """(R, 3, 3) whose columns are the Gaussians' axes in the world."""
    return rotation_matrices(scene.quaternions[rows].astype(np.float64))


def halves(scene: Gaussians, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Two parts of each Gaussian, side by side along its longest axis, that together have its mean and covariance.

    Parts whose standard deviation along the axis is σ/1.6 stand d to either side of the middle, d² = σ² - (σ/1.6)².
    Their opacities make the sum of what both hide as large as what the one did: o' = 1.6/2 o.

    Returns:
        offset (R, 3) of one part, that of the other is its negative; log scales (R, 3) and opacity logits (R,) of both.
    """
    log_scales = scene.log_scales[rows].astype(np.float64)
    each, longest = np.arange(len(rows)), log_scales.argmax(axis=1)
    distance = np.exp(log_scales[each, longest]) * np.sqrt(1.0 - SHRINKING**-2)
    offsets = axes_of(scene, rows)[each, :, longest] * distance[:, None]
    log_scales[each, longest] -= np.log(SHRINKING)
    opacities = 1.0 / (1.0 + np.exp(-scene.opacity_logits[rows].astype(np.float64)))
    return offsets.astype(np.float32), log_scales.astype(np.float32), logit(opacities * SHRINKING / 2)


def logit(opacities: np.ndarray) -> np.ndarray:
    """Opacity logits in float32."""
    return np.log(opacities / (1.0 - opacities)).astype(np.float32)
