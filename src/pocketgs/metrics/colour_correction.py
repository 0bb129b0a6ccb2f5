"""Colour correction of renderings: colours fitted to the photograph, to measure errors apart from exposure.

The definition is MultiNeRF's, which gsplat offers as quadratic colour correction: a quadratic polynomial from the
rendering's RGB to each channel of the photograph, fitted by least squares to pixels that neither image clips, in five
rounds. It uses the photograph that it is compared with, so it must only be used in metrics, never in training.
"""

from __future__ import annotations

import numpy as np

ROUNDS = 5
TERMS = 10
CLIPPED = 0.5 / 255
"""Values this close to 0 or 1, half a grey level, may be clipped."""

MAX_SAMPLES = 1 << 16
"""Maximum number of pixels for the fit, evenly spread: more give the same polynomial."""


def colour_corrected(rendered: np.ndarray, photo: np.ndarray, mask: np.ndarray | None = None) -> np.ndarray:
    """Fit the rendering's colours to the photograph's.

    Args:
        rendered: (H, W, 3) float RGB in [0, 1].
        photo: (H, W, 3) float RGB in [0, 1].
        mask: (H, W) bool, True for pixels that the fit may use, or None for all.

    Returns:
        (H, W, 3) float32 in [0, 1].
    """
    places = np.arange(photo.shape[0] * photo.shape[1]) if mask is None else np.flatnonzero(mask)
    places = places[:: len(places) // MAX_SAMPLES + 1]
    target = photo.reshape(-1, 3)[places].T.astype(np.float64)
    pixels = np.ascontiguousarray(rendered.reshape(-1, 3).T, dtype=np.float32)
    never_clipped = _unclipped(pixels[:, places]) & _unclipped(target)
    for _ in range(ROUNDS):
        samples = pixels[:, places].astype(np.float64)
        coefficients = _fit(_terms(samples), target, never_clipped & _unclipped(samples))
        pixels = np.clip(coefficients.astype(np.float32) @ _terms(pixels), 0.0, 1.0)
    return pixels.T.reshape(rendered.shape)


def _fit(terms: np.ndarray, target: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """(3, 10) coefficients, each channel fitted to its pixels in `counts` (3, N); the identity if there are none."""
    coefficients = np.zeros((3, TERMS))
    for channel, own in enumerate(counts):
        if own.any():
            chosen = terms[:, own]
            coefficients[channel] = np.linalg.lstsq(chosen @ chosen.T, chosen @ target[channel, own], rcond=None)[0]
        else:
            coefficients[channel, 6 + channel] = 1.0
    return coefficients


def _terms(pixels: np.ndarray) -> np.ndarray:
    """(10, N) products of two channels, the channels, and 1, from (3, N) pixels."""
    red, green, blue = pixels
    products = (red * red, red * green, red * blue, green * green, green * blue, blue * blue)
    return np.stack([*products, red, green, blue, np.ones_like(red)])


def _unclipped(values: np.ndarray) -> np.ndarray:
    return (values >= CLIPPED) & (values <= 1.0 - CLIPPED)
