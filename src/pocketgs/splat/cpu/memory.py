"""Memory estimate of the CPU engine for a given size of run."""

from __future__ import annotations

from collections.abc import Sequence

from pocketgs.splat.cpu.layout import INTERSECTION_FIELDS, SPLAT_FIELDS
from pocketgs.splat.cpu.statistics import STATISTICS
from pocketgs.splat.parameters import FLOAT_BYTES, ParameterLayout

INTERSECTIONS_PER_GAUSSIAN, INTERSECTIONS_PER_PIXEL = 2.5, 0.9
"""Tile intersections per Gaussian and per pixel: large Gaussians cover the image. Trained scenes have 84 to 108 % of
what follows from these; the reserve of a quarter covers the rest."""

INTERSECTION_BYTES = 2 * 5 * INTERSECTION_FIELDS + 5 * 16
"""The intersection, listed and distributed, and its 16 sums of 4 bytes each, with a quarter of reserve."""

PHOTOGRAPH_PIXEL = 3 + 1
"""Colour, and the mask if there is one."""

CANVAS_PIXEL = 4 * (3 + 1 + 3 + 3)
"""Colour, transmittance, the colour's gradient, and the colour after a photograph's transform."""


def training_bytes(gaussians: int, coefficients: int, photographs: Sequence[tuple[int, int]]) -> int:
    """Maximum bytes for training.

    Args:
        gaussians: number of Gaussians.
        coefficients: spherical-harmonics coefficients per channel.
        photographs: width and height of each.
    """
    layout = ParameterLayout(coefficients)
    pixels = [width * height for width, height in photographs]
    largest = max(pixels, default=0)
    # Scene, both moments and gradients; the projected splat, its key, its place in three orders, and its slots;
    # statistics.
    numbers = layout.numbers + 3 * layout.columns + SPLAT_FIELDS + 1 + 3 + 2 + STATISTICS + 1
    of_gaussians = gaussians * FLOAT_BYTES * numbers
    intersections = int(INTERSECTIONS_PER_GAUSSIAN * gaussians + INTERSECTIONS_PER_PIXEL * largest)
    return PHOTOGRAPH_PIXEL * sum(pixels) + of_gaussians + INTERSECTION_BYTES * intersections + CANVAS_PIXEL * largest
