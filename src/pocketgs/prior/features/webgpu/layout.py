"""Numbers of the scale space and of descriptors that shaders and host share; they are those of OpenCV's SIFT."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

LAYERS = 3
"""Layers per octave in which extrema are looked for; an octave has three more images."""

IMAGES = LAYERS + 3

SIGMA = 1.6
"""Blur of an octave's first image."""

BLUR_OF_PHOTOGRAPHS = 0.5
"""Blur that photographs are taken to have already."""

MOST_OCTAVES = 9

BORDER = 5
"""Pixels at the border in which no extrema are looked for."""

TILE = 16
"""Descriptors of either image that a workgroup compares at a time."""

CELLS, BINS = 4, 8
"""A descriptor has CELLS x CELLS cells with BINS directions each."""

KEYPOINTS, FEATURES = 0, 1
"""Places of the two counts."""

FEATURE = np.dtype(
    [
        ("place", np.float32, 2),
        ("scale", np.float32),
        ("response", np.float32),
        ("angle", np.float32),
        ("octave", np.uint32),
        ("layer", np.uint32),
        ("padding", np.uint32),
    ]
)
"""A keypoint or a feature: see `shaders/common/feature.wgsl`."""

NEAREST = np.dtype([("number", np.uint32), ("product", np.float32), ("next_product", np.float32)])
"""A descriptor's nearest: see `shaders/nearest.wgsl`."""

OCTAVE_BYTES = 4 * 4 * IMAGES
"""Bytes per pixel of a photograph of the largest buffer, the first octave."""

PIXEL_BYTES = 180
"""Bytes per pixel of a photograph of all buffers: octaves, an image at twice the size, keypoints and features."""

OTHER_BYTES = 8_000_000
"""Bytes of all buffers that do not grow with the photograph: descriptors, and what matching takes."""

CONSTANTS = {
    "LAYERS": LAYERS,
    "SIGMA": SIGMA,
    "BORDER": BORDER,
    "TILE": TILE,
    "CELLS": CELLS,
    "BINS": BINS,
    "KEYPOINTS": KEYPOINTS,
    "FEATURES": FEATURES,
    "TURN": 2 * math.pi,
    "EDGE": 10.0,  # maximum ratio of the curvatures
    "MOST_MOVES": 5,  # to the pixel where an extremum lies
    "DIRECTIONS": 36,  # of gradients around a keypoint
    "ORIENTATION_SIGMA": 1.5,  # of the window for these, in units of the keypoint's scale
    "PEAK": 0.8,  # share of the largest direction that makes a feature of its own
    "CELL_SIDE": 3.0,  # in units of the feature's scale
    "MOST_SHARE": 0.2,  # of a descriptor's length, for a single number
    "DESCRIPTOR_LENGTH": 512.0,  # before numbers are rounded
}


def kernels() -> list[np.ndarray]:
    """The kernels of an octave's blurs, from the middle on: of the first image, then from image to image."""
    first = math.sqrt(SIGMA**2 - (2 * BLUR_OF_PHOTOGRAPHS) ** 2)
    blurs = [SIGMA * 2 ** (layer / LAYERS) for layer in range(IMAGES)]
    steps = [math.sqrt(after**2 - before**2) for before, after in pairwise(blurs)]
    return [_gaussian(sigma) for sigma in (first, *steps)]


def _gaussian(sigma: float) -> np.ndarray:
    """Half a normalised kernel, as wide as OpenCV's for floating-point numbers."""
    radius = (round(8 * sigma + 1) | 1) // 2
    weights = np.exp(-(np.arange(radius + 1) ** 2) / (2 * sigma**2))
    return weights / (2 * weights.sum() - weights[0])
