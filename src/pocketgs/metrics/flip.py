"""FLIP, a perceptual error (Andersson et al. 2020), by NVIDIA's package `flip-evaluator`.

It predicts what people notice when they look from one image to the other and back. It needs no weights. Its package has
wheels for Linux and Windows on x86-64 and for macOS on Apple silicon; elsewhere there is no FLIP, which is no error.
"""

from __future__ import annotations

from importlib import import_module

import numpy as np


def flip(rendered: np.ndarray, photo: np.ndarray, mask: np.ndarray | None = None) -> float | None:
    """Mean FLIP error of two images of low dynamic range, at the package's own viewing distance (67 pixels a degree).

    Args:
        rendered: (H, W, 3) float RGB in [0, 1].
        photo: (H, W, 3) float RGB in [0, 1].
        mask: (H, W) bool; pixels outside it are made the photo's in both images, and do not enter the mean. None for
            none.

    Returns:
        A number from 0, for identical images, to 1; None where the package is not installed.
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
