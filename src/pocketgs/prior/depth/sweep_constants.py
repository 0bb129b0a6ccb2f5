"""The numbers of a plane sweep, which its CPU kernels and its shaders share."""

from __future__ import annotations

RADIUS = 3
"""Of the census' square window, in pixels."""

BITS = (2 * RADIUS + 1) ** 2 - 1
"""Bits of a census: the neighbours that each pixel is compared with."""

EDGE = 16
"""Difference in grey level that halves the penalty of a large step."""

NOISE = 8
"""Noise floor in bits per path: margins are measured relative to at least this."""

RIVAL_DISTANCE = 2
"""Hypotheses within this distance of the winner are not rivals."""

OUT_OF_REACH = 16_000
"""Cost of hypotheses beyond both ends of the range: more than any path's."""

SMOOTHING_WINDOW, SMOOTHING_WIDTH, SMOOTHING_STEPS = 9, 4.0, 3.0
"""Side and standard deviation in pixels of the window of the bilateral filter, and its standard deviation in
hypotheses."""
