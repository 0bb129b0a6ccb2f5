"""Adam on the Gaussians' parameters, with rotations in their tangent space."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from pocketgs.splat.reference.scene import Scene, SceneGradient
from pocketgs.splat.settings import AdamSettings, LearningRates


@dataclass
class Moments:
    """Running means of the gradient and of its square, and the number of steps taken."""

    first: SceneGradient
    second: SceneGradient
    steps: int = 0

    @staticmethod
    def zeros_for(gradient: SceneGradient) -> Moments:
        """Moments before the first step."""

        def zeros() -> SceneGradient:
            return SceneGradient(*(np.zeros_like(getattr(gradient, group.name)) for group in fields(gradient)))

        return Moments(zeros(), zeros())


def adam(scene: Scene, gradient: SceneGradient, moments: Moments, rates: LearningRates, settings: AdamSettings) -> None:
    """One step, in place (Kingma and Ba 2015, algorithm 1)."""
    moments.steps += 1
    moving = _has_gradient(gradient) if settings.seen_only else np.ones(len(gradient.means), bool)
    updates = {}
    for group in fields(gradient):
        g = getattr(gradient, group.name)[moving]
        first, second = getattr(moments.first, group.name), getattr(moments.second, group.name)
        first[moving] += (1 - settings.beta1) * (g - first[moving])
        second[moving] += (1 - settings.beta2) * (g * g - second[moving])
        mean = first[moving] / (1 - settings.beta1**moments.steps)
        spread = np.sqrt(second[moving] / (1 - settings.beta2**moments.steps))
        updates[group.name] = np.zeros_like(first)
        updates[group.name][moving] = mean / (spread + settings.epsilon)
    scene.means -= rates.means * updates["means"]
    scene.log_scales -= rates.log_scales * updates["log_scales"]
    scene.opacity_logits -= rates.opacity_logits * updates["opacity_logits"]
    scene.sh[:, :1] -= rates.sh_dc * updates["sh"][:, :1]
    scene.sh[:, 1:] -= rates.sh_rest * updates["sh"][:, 1:]
    scene.quaternions[:] = rotate(scene.quaternions, -rates.rotations * updates["rotations"])


def _has_gradient(gradient: SceneGradient) -> np.ndarray:
    """(N,) bool: Gaussians with a non-zero gradient."""
    groups = [getattr(gradient, group.name) for group in fields(gradient)]
    return np.any([np.any(g.reshape(len(g), -1) != 0, axis=1) for g in groups], axis=0)


def rotate(quaternions: np.ndarray, tangents: np.ndarray) -> np.ndarray:
    """Q ⊗ exp(½δ), normalised: (N, 4) quaternions turned by (N, 3) rotation vectors in their own axes."""
    angles = np.linalg.norm(tangents, axis=1, keepdims=True)
    # sin(θ/2)/θ without dividing by zero.
    vector = 0.5 * np.sinc(angles / (2 * np.pi)) * tangents
    w, v = np.cos(angles / 2), quaternions[:, 1:]
    scalar = quaternions[:, :1] * w - np.sum(v * vector, axis=1, keepdims=True)
    imaginary = quaternions[:, :1] * vector + w * v + np.cross(v, vector)
    turned = np.concatenate([scalar, imaginary], axis=1)
    return turned / np.linalg.norm(turned, axis=1, keepdims=True)
