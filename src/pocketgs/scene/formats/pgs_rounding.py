"""Rounding of a scene to the grids of a `.pgs`.

Rounding again changes nothing: what lies on a grid stays as it is. So a scene may be rounded one group of parameters
after the other, with the rest trained in between, and the file then holds it exactly.
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from pocketgs.geometry.quaternions import unit
from pocketgs.scene.formats.pgs_coding import DEFAULT, Coding
from pocketgs.scene.formats.pgs_rotations import quaternions_of, steps_of, turn_levels, with_named_axes
from pocketgs.scene.gaussians import Gaussians

GROUPS = ("means", "log_scales", "quaternions", "opacity_logits", "sh_dc", "sh_rest")
"""Groups of parameters that can be rounded. Log scales go before quaternions, or with them: the grid of quaternions
depends on the rounded log scales."""

GRID_BITS = 22
"""Bits of a coordinate, without its sign. Coordinates that need no more lie on a grid already; trained ones need 24."""

MAX_LEVEL = 1 << 16
"""The largest multiple of a step, except for coordinates."""

MAX_LOGIT = 12.0


def rounded(gaussians: Gaussians, coding: Coding = DEFAULT, names: Collection[str] = GROUPS) -> Gaussians:
    """Round groups of parameters to what a `.pgs` can hold; the order of Gaussians stays.

    Rounding quaternions names a Gaussian's axes anew, unless its rotation lies on the grid: its log scales then change
    places.

    Args:
        gaussians: the scene; its numbers are finite, except for opacity logits.
        coding: the steps.
        names: of `GROUPS`.
    """
    coding = coding.in_single_precision()
    means, log_scales, quaternions = gaussians.means, gaussians.log_scales, gaussians.quaternions
    opacity_logits, sh = gaussians.opacity_logits, gaussians.sh.copy()
    if "means" in names:
        means = rounded_means(means, log_scales, coding.position)
    if "log_scales" in names:
        log_scales = on_grid(log_scales, coding.log_scale)
    if "quaternions" in names:
        log_scales, quaternions = rounded_rotations(log_scales, quaternions, coding)
    if "opacity_logits" in names:
        opacity_logits = on_grid(np.clip(opacity_logits, -MAX_LOGIT, MAX_LOGIT), coding.opacity)
    if "sh_dc" in names:
        sh[:, 0] = on_grid(sh[:, 0], coding.colour)
    if "sh_rest" in names:
        is_small = np.abs(sh[:, 1:]) < coding.dead_zone * coding.harmonics
        sh[:, 1:] = np.where(is_small, np.float32(0.0), on_grid(sh[:, 1:], coding.harmonics))
    return Gaussians(means, log_scales, quaternions, opacity_logits, sh)


def levels(values: np.ndarray, step: float | np.ndarray) -> np.ndarray:
    """The nearest multiples of a step, as int64."""
    return np.clip(np.rint(values.astype(np.float64) / step), -MAX_LEVEL, MAX_LEVEL).astype(np.int64)


def on_grid(values: np.ndarray, step: float) -> np.ndarray:
    """The nearest multiples of a step, as float32."""
    return (levels(values, step) * step).astype(np.float32)


def grid_exponent(means: np.ndarray) -> int | None:
    """Exponent of the coarsest power of two that all coordinates are multiples of; None if they need too many bits."""
    finest = finest_exponent(means)
    multiples = np.ldexp(means.astype(np.float64), -finest)
    if np.any(multiples != np.rint(multiples)):
        return None
    together = int(np.bitwise_or.reduce(np.abs(multiples).astype(np.int64), axis=None))
    return finest + (together & -together).bit_length() - 1 if together else 0


def finest_exponent(means: np.ndarray) -> int:
    """Exponent of the smallest step that the format allows for these coordinates."""
    return int(np.frexp(np.abs(means).max().astype(np.float64))[1]) - GRID_BITS


def rounded_means(means: np.ndarray, log_scales: np.ndarray, share: float) -> np.ndarray:
    """Round each centre to a power of two of at most a share of the Gaussian's middle standard deviation."""
    if grid_exponent(means) is not None:
        return means
    sizes = np.median(log_scales.astype(np.float64), axis=1) / np.log(2.0)
    # One more than the finest: the largest coordinate may be rounded up to the next power of two. And at most half of
    # the largest coordinate, so that nothing overflows.
    finest = finest_exponent(means) + 1
    exponents = np.clip(np.floor(sizes + np.log2(share)), finest, finest + GRID_BITS - 2).astype(np.int64)[:, None]
    return np.ldexp(np.rint(np.ldexp(means.astype(np.float64), -exponents)), exponents).astype(np.float32)


def rounded_rotations(log_scales: np.ndarray, quaternions: np.ndarray, coding: Coding) -> tuple[np.ndarray, np.ndarray]:
    """Name the axes of Gaussians whose rotations are not on the grid, and round these rotations.

    Returns:
        (N, 3) log scales in the order of the named axes, not rounded, and (N, 4) quaternions.
    """
    near = _rounded_turns(log_scales, unit(quaternions), coding)
    is_new = np.any(near != quaternions, axis=1)
    log_scales, result = log_scales.copy(), quaternions.copy()
    shown = levels(log_scales[is_new], coding.log_scale)
    order, named = with_named_axes(shown, quaternions[is_new])
    log_scales[is_new] = np.take_along_axis(log_scales[is_new], order, axis=1)
    result[is_new] = _rounded_turns(log_scales[is_new], named, coding)
    return log_scales, result


def _rounded_turns(log_scales: np.ndarray, quaternions: np.ndarray, coding: Coding) -> np.ndarray:
    steps = steps_of(levels(log_scales, coding.log_scale) * coding.log_scale, coding.rotation)
    return quaternions_of(turn_levels(quaternions, steps) * steps)
