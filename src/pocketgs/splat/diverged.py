"""Gaussians whose colour has diverged: images without colours must not show them either, nor what they would hide."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pocketgs.geometry.camera import Camera
from pocketgs.scene.gaussians import Gaussians
from pocketgs.scene.spherical_harmonics import basis
from pocketgs.splat.constants import BRIGHTEST


def suspects(scene: Gaussians) -> np.ndarray:
    """(M,) ascending: the Gaussians whose colour may reach BRIGHTEST, or be not finite, from some direction."""
    coefficients = scene.sh.shape[1]
    # Σ_k Y_k² = K / 4π from every direction (Unsöld's theorem), and |Σ_k Y_k s_k| ≤ √(Σ_k Y_k²) √(Σ_k s_k²).
    harmless = (BRIGHTEST - 0.5) / (coefficients * np.sqrt(0.25 / np.pi))
    # Almost always there are none, and then two extrema tell, which take no memory. NaN is not below anything.
    if max(scene.sh.max(initial=0.0), -scene.sh.min(initial=0.0)) < harmless:
        return np.empty(0, np.intp)
    return np.flatnonzero(~(np.abs(scene.sh).max(axis=(1, 2)) < harmless))


def without_diverged(scene: Gaussians, rows: np.ndarray, camera: Camera) -> Gaussians:
    """A scene of which engines do not draw what a camera would see in a diverged colour.

    Args:
        scene: the Gaussians.
        rows: its `suspects`.
        camera: of the view.
    """
    if len(rows) == 0:
        return scene
    with np.errstate(all="ignore"):
        offsets = scene.means[rows] - camera.centre
        directions = offsets / np.linalg.norm(offsets, axis=1, keepdims=True)
        colours = 0.5 + np.einsum("nk,nkc->nc", basis(directions, scene.sh.shape[1]), scene.sh[rows])
        diverged = ~np.all(np.abs(colours) < BRIGHTEST, axis=1)
    logits = scene.opacity_logits.copy()
    logits[rows[diverged]] = -np.inf
    return replace(scene, opacity_logits=logits)
