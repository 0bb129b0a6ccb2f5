"""Sizes that the shaders of splats and the host agree on."""

from __future__ import annotations

from pocketgs.splat.constants import SSIM_WINDOW

TILE = 8
"""A tile is a square of so many pixels on each side."""

PATCH = 16
"""The loss is computed on squares of so many pixels on each side."""

MARGIN = SSIM_WINDOW // 2
"""What a patch needs to know of the pixels around it."""
