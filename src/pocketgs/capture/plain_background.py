"""The background of photographs without alpha that show an object before one plain colour."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pocketgs.capture.capture import Frame
from pocketgs.scene.background import Background

LIKE = 4
"""Difference of colours, of 255, up to which pixels count as one plain colour: JPEG leaves some."""

LEAST_SHARE = 0.75
"""Least share of the pixels at the photographs' edges. Cut-outs have nearly all; an overexposed sky has half."""


def plain_background(frames: Sequence[Frame]) -> Background | None:
    """The one colour that nearly all pixels at the photographs' edges have, such as the white of product photographs.

    What lies there looks the same in all directions. On another background, Gaussians have to be it, all around the
    object and before the cameras.

    Args:
        frames: photographs of a capture. Pixels that masks exclude do not count.

    Returns:
        RGB in [0, 1]; None if the edges have no such colour, or a photograph has alpha, which tells the background.
    """
    if any(frame.alpha is not None for frame in frames):
        return None
    edges = np.concatenate([_edge(frame) for frame in frames])
    if not len(edges):
        return None
    colour = np.median(edges, axis=0)
    share = np.mean(np.abs(edges - colour).max(axis=1) <= LIKE)
    if share < LEAST_SHARE:
        return None
    red, green, blue = (colour / 255.0).tolist()
    return (red, green, blue)


def _edge(frame: Frame) -> np.ndarray:
    """(N, 3) uint8 colours of the outermost pixels that its mask does not exclude."""
    at_edge = np.ones(frame.image.shape[:2], dtype=bool)
    at_edge[1:-1, 1:-1] = False
    if frame.mask is not None:
        at_edge &= frame.mask
    return frame.image[at_edge]
