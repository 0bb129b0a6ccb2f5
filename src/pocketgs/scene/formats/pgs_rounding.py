"""Rounding of a scene to the grids of a `.pgs`.

Rounding again changes nothing: what lies on a grid stays as it is. So a scene may be rounded one group of parameters
after the other, with the rest trained in between, and the file then holds it exactly.
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from pocketgs.geometry.quaternions import unit
from pocketgs.scene.formats.codebook_weights import codebook_weights
from pocketgs.scene.formats.codebooks import nearest, vector_codebook
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

SAME_ROTATION = 1e-6
"""Maximum difference of quaternions that float32 rounding explains; grids are far coarser."""

MAX_ENTRIES = 1 << 14
"""Entries of a codebook that the file can hold. A scene with more distinct vectors is stored without one, and so is
one where that takes less."""

MIN_ENTRIES = 256
"""Entries of the smallest codebook."""


def rounded(
    gaussians: Gaussians,
    coding: Coding = DEFAULT,
    names: Collection[str] = GROUPS,
    weights: np.ndarray | None = None,
) -> Gaussians:
    """Round groups of parameters to what a `.pgs` can hold; the order of Gaussians stays.

    Rounding quaternions names a Gaussian's axes anew, unless its rotation lies on the grid: its log scales then change
    places.

    Args:
        gaussians: the scene; its numbers are finite, except for opacity logits.
        coding: the steps.
        names: of `GROUPS`.
        weights: (N,) positive, for the codebook of harmonics; by default the square root of opacity times size.
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
        weights = codebook_weights(gaussians) if weights is None else weights
        sh[:, 1:] = rounded_harmonics(sh[:, 1:], weights, coding)
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
        return means + 0.0
    sizes = np.median(log_scales.astype(np.float64), axis=1) / np.log(2.0)
    # One more than the finest: the largest coordinate may be rounded up to the next power of two. And at most half of
    # the largest coordinate, so that nothing overflows.
    finest = finest_exponent(means) + 1
    exponents = np.clip(np.floor(sizes + np.log2(share)), finest, finest + GRID_BITS - 2).astype(np.int64)[:, None]
    multiples = np.rint(np.ldexp(means.astype(np.float64), -exponents))
    # Adding 0 makes -0 positive: the file has one zero.
    return (np.ldexp(multiples, exponents) + 0.0).astype(np.float32)


def rounded_harmonics(rest: np.ndarray, weights: np.ndarray, coding: Coding) -> np.ndarray:
    """Replace (N, K - 1, 3) coefficients by the nearest entries of a codebook on the grid."""
    rows = rest.reshape(len(rest), -1)
    if rows.size == 0 or (
        np.array_equal(on_grid(rows, coding.harmonics), rows)
        and len(distinct_rows(levels(rows, coding.harmonics))[0]) <= MAX_ENTRIES
    ):
        return rest
    if not coding.entries:
        return on_grid(rest, coding.harmonics)
    entries = min(coding.entries, max(len(rows) // coding.per_entry, MIN_ENTRIES))
    book = on_grid(vector_codebook(rows, entries, weights), coding.harmonics)
    return book[nearest(rows, book)].reshape(rest.shape)


def distinct_rows(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The distinct rows of (N, D) integers below 2^31, in a fixed order, and (N,) which of them each row is."""
    packed = np.ascontiguousarray(rows, ">i4").view(f"V{4 * rows.shape[1]}").ravel()
    _, first, labels = np.unique(packed, return_index=True, return_inverse=True)
    return rows[first], labels.reshape(-1)


def rounded_rotations(log_scales: np.ndarray, quaternions: np.ndarray, coding: Coding) -> tuple[np.ndarray, np.ndarray]:
    """Name the axes of Gaussians whose rotations are not on the grid, and round these rotations.

    Returns:
        (N, 3) log scales in the order of the named axes, not rounded, and (N, 4) quaternions.
    """
    result = _rounded_turns(log_scales, unit(quaternions), coding)
    # Training normalises quaternions, which changes their last bits even where rotations are frozen.
    is_new = np.any(~(np.abs(result - quaternions) <= SAME_ROTATION), axis=1)
    log_scales = log_scales.copy()
    shown = levels(log_scales[is_new], coding.log_scale)
    order, named = with_named_axes(shown, quaternions[is_new])
    log_scales[is_new] = np.take_along_axis(log_scales[is_new], order, axis=1)
    result[is_new] = _rounded_turns(log_scales[is_new], named, coding)
    return log_scales, result


def _rounded_turns(log_scales: np.ndarray, quaternions: np.ndarray, coding: Coding) -> np.ndarray:
    steps = steps_of(levels(log_scales, coding.log_scale) * coding.log_scale, coding.rotation)
    return quaternions_of(turn_levels(quaternions, steps) * steps)
