"""Sizes that shaders and host agree on; `composition.py` writes them out at the top of every shader."""

from __future__ import annotations

from pocketgs.splat.constants import SSIM_WINDOW

THREADS = 256
"""Of most workgroups: as many as every device must allow."""

TILE = 8
"""A tile is a square of so many pixels a side."""

PATCH = 16
"""The loss is computed on squares of so many pixels a side."""

MARGIN = SSIM_WINDOW // 2
"""What a patch needs to know of the pixels around it."""

BLOCK = 2048
"""Keys that a workgroup sorts."""

DIGIT_BITS = 4
"""The radix sort's digits."""

LONGEST_ROW = 65_535
"""No dimension of a dispatch may be longer."""

SHARED = {
    "THREADS": THREADS,
    "TILE": TILE,
    "PATCH": PATCH,
    "MARGIN": MARGIN,
    "BLOCK": BLOCK,
    "DIGIT_BITS": DIGIT_BITS,
    "LONGEST_ROW": LONGEST_ROW,
}
