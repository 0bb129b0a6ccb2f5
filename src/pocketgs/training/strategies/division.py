"""Splitting a Gaussian into two: positions and sizes of the parts."""

from __future__ import annotations

import numpy as np

from pocketgs.geometry.quaternions import rotation_matrices
from pocketgs.scene.gaussians import Gaussians

SHRINKING = 1.6
"""Factor by which the parts of a split Gaussian are smaller (3DGS, section 5.2)."""


def drawn_within(scene: Gaussians, rows: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(R, 3) float32 points sampled from the Gaussians of some rows."""
    offsets = rng.standard_normal((len(rows), 3)) * np.exp(scene.log_scales[rows].astype(np.float64))
    turned = np.einsum("nij,nj->ni", axes_of(scene, rows), offsets)
    return (scene.means[rows] + turned).astype(np.float32)


def axes_of(scene: Gaussians, rows: np.ndarray) -> np.ndarray:
    """(R, 3, 3) matrices whose columns are the Gaussians' axes in the world."""
    return rotation_matrices(scene.quaternions[rows].astype(np.float64))


def halves(scene: Gaussians, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Split Gaussians along their longest axis into two parts that together keep the mean and covariance.

    The parts have the standard deviation σ/1.6 along the axis, and are at distance d on either side of the mean, with
    d² = σ² - (σ/1.6)². Their opacities o' = 1.6/2 o keep the sum of opacity times length.

    Returns:
        Offsets (R, 3) of the first parts, whose negatives are those of the second; log scales (R, 3) and opacity logits
        (R,) of both.
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
