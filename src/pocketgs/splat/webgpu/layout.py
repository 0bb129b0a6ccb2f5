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
"""Width of the border of pixels around a patch that its loss depends on."""

SPLAT_WORDS = {"f32": 10, "f16": 7, "weighted": 11}
"""Of a splat on the image, by the way it is stored; see `common/splats.wgsl`. In full precision: centre 2, depth, log2
of the opacity, exponents 3, colour 3."""

RECORD_WORDS = {"f32": 5, "f16": 3}
"""Of a record of the replay cache, by the way it is stored; see `common/replay.wgsl`."""

SUM_WORDS = 9
"""Of a row of gradients; see `common/gradient_rows.wgsl`."""

SHAPE_WORDS = 8
"""Of a row of gradients, before those of the channels; see `common/channel_rows.wgsl`."""

CENTRE_WORDS = 4
"""Of a Gaussian's row in `channel_gradients`, before the channels: the centre's gradient, signed and absolute."""

BOUND_WORDS = 8
"""Of a cluster's bounds; see `common/clusters.wgsl`."""

WORDS = {
    **{f"SPLAT_WORDS_{kind.upper()}": words for kind, words in SPLAT_WORDS.items()},
    **{f"RECORD_WORDS_{kind.upper()}": words for kind, words in RECORD_WORDS.items()},
    "SUM_WORDS": SUM_WORDS,
    "SHAPE_WORDS": SHAPE_WORDS,
    "CENTRE_WORDS": CENTRE_WORDS,
    "BOUND_WORDS": BOUND_WORDS,
}
"""The same sizes by their names in the shaders."""

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
"""First column in `shape` of each parameter but the spherical harmonics, by name."""

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
"""First column of each parameter, in `shape` and in gradients and moments, by its name in the shaders."""
