"""Sizes and places that the shaders of splats and the host agree on."""

from __future__ import annotations

from itertools import accumulate

from pocketgs.splat.constants import SSIM_WINDOW
from pocketgs.splat.parameters import ParameterLayout

TILE = 8
"""A tile is a square of so many pixels on each side."""

PATCH = 16
"""The loss is computed on squares of so many pixels on each side."""

MARGIN = SSIM_WINDOW // 2
"""What a patch needs to know of the pixels around it."""

_WITHOUT_SH = ParameterLayout(0)

SHAPE_COLUMNS = _WITHOUT_SH.numbers
"""Of the table `shape`, which holds all parameters but the spherical harmonics."""

GRADIENT_COLUMNS = _WITHOUT_SH.columns
"""Of gradients and moments, before those of the spherical harmonics, which follow."""

_SHAPE = [group for group in _WITHOUT_SH.groups if group.name != "sh"]
FIRST_COLUMNS = dict(
    zip(
        (group.name for group in _SHAPE),
        accumulate((group.numbers(0) for group in _SHAPE[:-1]), initial=0),
        strict=True,
    )
)
"""Where each parameter but the spherical harmonics begins in `shape`, by name."""

PLACES = {
    "MEAN": FIRST_COLUMNS["means"],
    "LOG_SCALE": FIRST_COLUMNS["log_scales"],
    "QUATERNION": FIRST_COLUMNS["quaternions"],
    "OPACITY_LOGIT": FIRST_COLUMNS["opacity_logits"],
    "GRADIENT_MEAN": _WITHOUT_SH.columns_of("means").start,
    "GRADIENT_LOG_SCALE": _WITHOUT_SH.columns_of("log_scales").start,
    "GRADIENT_ROTATION": _WITHOUT_SH.columns_of("quaternions").start,
    "GRADIENT_OPACITY": _WITHOUT_SH.columns_of("opacity_logits").start,
    "GRADIENT_SH": GRADIENT_COLUMNS,
}
"""What the shaders call the first column of each parameter, in `shape` and in gradients and moments."""
