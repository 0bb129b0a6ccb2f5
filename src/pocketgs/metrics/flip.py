"""FLIP, a perceptual error (Andersson et al. 2020), from NVIDIA's package `flip-evaluator`.

It predicts the differences that people notice when they flip between two images. It needs no weights. Its package has
wheels for Linux and Windows on x86-64 and for macOS on Apple silicon; elsewhere FLIP is omitted, without an error.
"""

from __future__ import annotations

from importlib import import_module

import numpy as np


def flip(rendered: np.ndarray, photo: np.ndarray, mask: np.ndarray | None = None) -> float | None:
    """Mean FLIP error of two low-dynamic-range images, at the default viewing distance (67 pixels per degree).

    Args:
        rendered: (H, W, 3) float RGB in [0, 1].
        photo: (H, W, 3) float RGB in [0, 1].
        mask: (H, W) bool, None for all. Pixels outside it are replaced by the photograph's in both images, and excluded
            from the mean.

    Returns:
        A number from 0, for identical images, to 1; None if the package is not installed.
    """
    try:
        evaluator = import_module("flip_evaluator")
    except ImportError:
        return None
    if mask is not None:
        rendered = np.where(mask[:, :, None], rendered, photo)
    reference, test = (np.ascontiguousarray(image, dtype=np.float32) for image in (photo, rendered))
    errors = evaluator.evaluate(reference, test, "LDR", applyMagma=False, computeMeanError=False)[0][..., 0]
    return float(np.mean(errors if mask is None else errors[mask], dtype=np.float64))
