"""Noise on the positions of transparent Gaussians, the exploration term of 3DGS-MCMC."""

from __future__ import annotations

import math

from numba import prange

from pocketgs.splat.constants import NOISE_STEEPNESS, NOISE_THRESHOLD
from pocketgs.splat.cpu.hash import pcg_hash
from pocketgs.splat.cpu.layout import SceneArrays
from pocketgs.splat.cpu.vectors import axes_of, dot
from pocketgs.system.compile import inlined, parallel_kernel, part
from pocketgs.system.dealing import PIECE, first_piece, take


@part
def _normal(seed: int, row: int, number: int) -> float:
    """A standard normal number, a pure function of its arguments (Box and Muller 1958)."""
    word = pcg_hash(pcg_hash(pcg_hash(seed & 0xFFFFFFFF) ^ row) ^ number)
    other = pcg_hash(word ^ 0x9E3779B9)
    uniform = (word + 1.0) / 4294967296.0
    return math.sqrt(-2.0 * math.log(uniform)) * math.cos(2.0 * math.pi * other / 4294967296.0)


@inlined
def _shake(scene: SceneArrays, i: int, size: float, seed: int) -> None:
    """`add_noise` for Gaussian i."""
    opacity = 1.0 / (1.0 + math.exp(-float(scene.opacity_logits[i])))
    factor = size / (1.0 + math.exp(NOISE_STEEPNESS * (opacity - NOISE_THRESHOLD)))
    axes = axes_of(scene.quaternions[i])
    eta = (_normal(seed, i, 0), _normal(seed, i, 1), _normal(seed, i, 2))
    for k in range(3):
        axis = axes[k]
        along = factor * math.exp(2.0 * float(scene.log_scales[i, k])) * dot(axis, eta)
        for c in range(3):
            scene.means[i, c] += along * axis[c]


@parallel_kernel
def add_noise(scene: SceneArrays, size: float, seed: int, threads: int) -> None:
    """Move every mean by size · σ(-k (o - t)) Σ η with η normal (Kheradmand et al. 2024, equation 8), in place.

    Args:
        scene: the Gaussians, whose means are updated.
        size: factor, in inverse units of length.
        seed: determines the noise, on any number of threads.
        threads: number of threads.
    """
    counter = first_piece()
    for _ in prange(threads):
        piece = PIECE * take(counter)
        while piece < len(scene.means):
            for i in range(piece, min(piece + PIECE, len(scene.means))):
                _shake(scene, i, size, seed)
            piece = PIECE * take(counter)
