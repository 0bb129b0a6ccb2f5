"""Weights of Gaussians in vector codebooks: how much errors of their harmonics show."""

from __future__ import annotations

import numpy as np

from pocketgs.scene.gaussians import Gaussians

MAX_LOG, MAX_LOGIT = 3.5, 50.0


def codebook_weights(gaussians: Gaussians) -> np.ndarray:
    """(N,) square roots of opacity times the larger two standard deviations, within 33 times the middle one."""
    sizes = np.sort(gaussians.log_scales.astype(np.float64), axis=1)[:, 1:].sum(axis=1)
    log_weights = 0.5 * (sizes - np.logaddexp(0.0, -np.clip(gaussians.opacity_logits, -MAX_LOGIT, MAX_LOGIT)))
    return np.exp(np.clip(log_weights - np.median(log_weights), -MAX_LOG, MAX_LOG))
