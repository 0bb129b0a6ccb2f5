"""Conversion between a scene's logits and coefficients and the opacities and colours in files."""

from __future__ import annotations

import numpy as np

from pocketgs.scene.gaussians import SH_DC

MIN_LOG_SCALE = float(np.log(np.finfo(np.float32).tiny))
"""Logarithm of the smallest thickness that float32 holds in full precision."""

OPACITY_STEPS = 255
"""8-bit opacities are multiples of 1 / 255."""


def finite_log_scales(log_scales: np.ndarray) -> np.ndarray:
    """Logarithms of standard deviations, with a finite one for a thickness of 0, which is drawn the same."""
    return np.where(log_scales == -np.inf, np.float32(MIN_LOG_SCALE), log_scales)


def opacity_of(logits: np.ndarray) -> np.ndarray:
    """(N,) float64 opacities in [0, 1]; infinite logits give exactly 0 and 1."""
    return 0.5 * (1.0 + np.tanh(0.5 * logits.astype(np.float64)))


def logit_of(opacities: np.ndarray, margin: float) -> np.ndarray:
    """(N,) finite logits of opacities, which are first clamped to at least `margin` from 0 and 1."""
    inside = np.clip(opacities.astype(np.float64), margin, 1.0 - margin)
    return np.log(inside) - np.log1p(-inside)


def opacity_to_byte(logits: np.ndarray) -> np.ndarray:
    """(N,) uint8 opacities."""
    return to_byte(opacity_of(logits) * OPACITY_STEPS)


def opacity_from_byte(stored: np.ndarray) -> np.ndarray:
    """(N,) logits of uint8 opacities; 0 and 255 decode to the middle of their rounding intervals."""
    return logit_of(stored / OPACITY_STEPS, margin=0.25 / OPACITY_STEPS)


def colour_of(dc: np.ndarray) -> np.ndarray:
    """Colours of spherical-harmonics coefficients of degree 0, not clamped to [0, 1]."""
    return 0.5 + SH_DC * dc.astype(np.float64)


def dc_of(colours: np.ndarray) -> np.ndarray:
    """Spherical-harmonics coefficients of degree 0 of colours."""
    return (colours - 0.5) / SH_DC


def to_byte(numbers: np.ndarray) -> np.ndarray:
    """Round to uint8, clamped to its range."""
    return np.clip(np.round(numbers), 0, 255).astype(np.uint8)
