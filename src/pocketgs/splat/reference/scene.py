"""Gaussians and their gradient in float64."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from pocketgs.scene.gaussians import PARAMETERS, Gaussians


@dataclass
class Scene:
    """`Gaussians` in float64: same names, shapes and meaning."""

    means: np.ndarray
    log_scales: np.ndarray
    quaternions: np.ndarray
    opacity_logits: np.ndarray
    sh: np.ndarray

    @staticmethod
    def of(gaussians: Gaussians) -> Scene:
        """A float64 copy."""
        return Scene(*(getattr(gaussians, name).astype(np.float64) for name in PARAMETERS))

    def select(self, indices: np.ndarray) -> Scene:
        """The Gaussians selected by an index array."""
        return Scene(*(getattr(self, name)[indices] for name in PARAMETERS))


@dataclass
class SceneGradient:
    """Gradient of the loss in the spaces of Adam's updates: `rotations` (N, 3) is in the tangent space."""

    means: np.ndarray
    log_scales: np.ndarray
    rotations: np.ndarray
    opacity_logits: np.ndarray
    sh: np.ndarray

    @staticmethod
    def scatter(count: int, indices: np.ndarray, *parts: np.ndarray) -> SceneGradient:
        """Arrays of `count` rows with `parts` at `indices` and zero elsewhere."""
        gradient = SceneGradient(*(np.zeros((count, *part.shape[1:])) for part in parts))
        for group, part in zip(fields(gradient), parts, strict=True):
            getattr(gradient, group.name)[indices] = part
        return gradient
