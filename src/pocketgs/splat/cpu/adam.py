"""Adam over all parameters in one pass, each group in its own space and at its own rate."""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from pocketgs.splat.cpu.layout import (
    CLUSTER,
    GRADIENT_LOG_SCALE,
    GRADIENT_MEAN,
    GRADIENT_OPACITY,
    GRADIENT_ROTATION,
    GRADIENT_SH,
    SceneArrays,
)
from pocketgs.splat.settings import AdamSettings
from pocketgs.splat.store import ParameterStore
from pocketgs.system.compile import inlined, parallel_kernel, part
from pocketgs.system.dealing import first_piece, take


@part
def _turn(quaternion: np.ndarray, x: float, y: float, z: float) -> None:
    """Q ← q ⊗ exp(½ (x, y, z)), normalised."""
    half_angle = 0.5 * math.sqrt(x * x + y * y + z * z)
    factor = 0.5 * (math.sin(half_angle) / half_angle if half_angle > 1e-8 else 1.0)
    a, b, c, d = math.cos(half_angle), factor * x, factor * y, factor * z
    w, i, j, k = float(quaternion[0]), float(quaternion[1]), float(quaternion[2]), float(quaternion[3])
    rw, ri = w * a - i * b - j * c - k * d, w * b + i * a + j * d - k * c
    rj, rk = w * c - i * d + j * a + k * b, w * d + i * c - j * b + k * a
    norm = math.sqrt(rw * rw + ri * ri + rj * rj + rk * rk)
    quaternion[0], quaternion[1], quaternion[2], quaternion[3] = rw / norm, ri / norm, rj / norm, rk / norm


@inlined
def _move(scene: SceneArrays, i: int, step: np.ndarray) -> None:
    """Subtract a step (columns,) from Gaussian i's parameters."""
    for k in range(3):
        scene.means[i, k] -= step[GRADIENT_MEAN + k]
        scene.log_scales[i, k] -= step[GRADIENT_LOG_SCALE + k]
    x, y, z = step[GRADIENT_ROTATION], step[GRADIENT_ROTATION + 1], step[GRADIENT_ROTATION + 2]
    _turn(scene.quaternions[i], -x, -y, -z)
    scene.opacity_logits[i] -= step[GRADIENT_OPACITY]
    for k in range((len(step) - GRADIENT_SH) // 3):
        for channel in range(3):
            scene.sh[i, k, channel] -= step[GRADIENT_SH + 3 * k + channel]


@parallel_kernel
def adam(
    scene: SceneArrays,
    gradients: np.ndarray,
    first_moments: np.ndarray,
    second_moments: np.ndarray,
    rates: np.ndarray,
    decay1: float,
    decay2: float,
    epsilon: float,
    steps: int,
    seen_only: bool,
    clusters: np.ndarray,
    threads: int,
) -> None:
    """One step of Adam (Kingma and Ba 2015, algorithm 1), in place.

    Args:
        scene: the Gaussians, updated. Quaternions move in their tangent space.
        gradients: (N, C) float32.
        first_moments: (N, C) float32, updated.
        second_moments: (N, C) float32, updated.
        rates: (C,) float32 by column; if shorter, the parameters and moments of the last columns stay unchanged.
        decay1: β₁.
        decay2: β₂.
        epsilon: ε.
        steps: number of steps including this one.
        seen_only: skip Gaussians whose gradient is zero, including their moments.
        clusters: (M,) int32 clusters to update; the others stay unchanged.
        threads: number of threads.
    """
    columns = len(rates)
    keep1, take1 = np.float32(decay1), np.float32(1.0 - decay1)
    keep2, take2 = np.float32(decay2), np.float32(1.0 - decay2)
    unbias1 = np.float32(1.0 / (1.0 - decay1**steps))
    unbias2 = np.float32(1.0 / (1.0 - decay2**steps))
    guard = np.float32(epsilon)
    counter = first_piece()
    for _ in prange(threads):
        step = np.empty(columns, np.float32)
        place = take(counter)
        while place < len(clusters):
            cluster = clusters[place]
            for i in range(cluster * CLUSTER, min((cluster + 1) * CLUSTER, len(scene.means))):
                gradient, first, second = gradients[i], first_moments[i], second_moments[i]
                if seen_only and not np.any(gradient):
                    continue
                for c in range(columns):
                    g = gradient[c]
                    first[c] = keep1 * first[c] + take1 * g
                    second[c] = keep2 * second[c] + take2 * g * g
                    step[c] = rates[c] * first[c] * unbias1 / (np.sqrt(second[c] * unbias2) + guard)
                _move(scene, i, step)
            place = take(counter)


def update(
    store: ParameterStore, rates: np.ndarray, settings: AdamSettings, steps: int, clusters: np.ndarray, threads: int
) -> None:
    """Update a store's parameters from its gradients; see `adam`."""
    adam(
        SceneArrays.of(store.scene),
        store.gradients,
        store.first_moments,
        store.second_moments,
        rates,
        settings.beta1,
        settings.beta2,
        settings.epsilon,
        steps,
        settings.seen_only,
        clusters,
        threads,
    )


def regularise(
    log_scales: np.ndarray,
    opacity_logits: np.ndarray,
    scale_weight: float,
    opacity_weight: float,
    size_weight: float,
    gradients: np.ndarray,
) -> float:
    """Add the gradient of λ_s mean ‖log s‖² + λ_α mean α + λ_r mean Σ s to `gradients`; return the value."""
    count = len(log_scales)
    scales = slice(GRADIENT_LOG_SCALE, GRADIENT_LOG_SCALE + 3)
    # Diverged Gaussians may overflow: they are not drawn, and must not cause a warning at every step.
    with np.errstate(over="ignore", invalid="ignore"):
        opacities = 1.0 / (1.0 + np.exp(-opacity_logits))
        gradients[:, scales] += 2.0 * scale_weight / count * log_scales
        gradients[:, GRADIENT_OPACITY] += opacity_weight / count * opacities * (1.0 - opacities)
        value = scale_weight * np.sum(log_scales**2) + opacity_weight * np.sum(opacities)
        if size_weight:
            sizes = np.exp(log_scales)
            gradients[:, scales] += size_weight / count * sizes
            value += size_weight * np.sum(sizes)
        return float(value) / count
