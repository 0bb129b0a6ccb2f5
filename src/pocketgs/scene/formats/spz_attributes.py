"""Encoding of the numbers of a `.spz`: rounding and sizes.

Six streams follow one another, each for all Gaussians: positions (24-bit fixed point), opacities, colours, log scales
(8 bits per number), rotations, and spherical harmonics (8 bits per coefficient, red, green, blue innermost).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pocketgs.geometry.quaternions import MAX_OTHER, drop_largest, restore_largest, unit
from pocketgs.scene.formats.activations import OPACITY_STEPS, opacity_from_byte, opacity_of
from pocketgs.scene.formats.spz_precision import Precision
from pocketgs.scene.gaussians import SH_COEFFICIENTS, Gaussians

MAX_FIXED = 2**23 - 1
COLOUR_SCALE = 0.15 * 255
"""Byte steps per unit of the coefficient of degree 0: less than the visible range needs, so colours can exceed it."""

LOG_SCALE_ORIGIN, LOG_SCALE_STEPS = -10.0, 16.0
SH_STEPS, SH_ZERO = 128.0, 128
ROTATION_STEPS = 511
"""Steps of each component's 9-bit magnitude."""


@dataclass(frozen=True)
class Layout:
    """The sizes and number formats that the header states.

    Attributes:
        version: 1 to 4.
        count: number of Gaussians.
        sh_degree: 0 to 4; we keep at most 3.
        fractional_bits: of the fixed-point positions.
    """

    version: int
    count: int
    sh_degree: int
    fractional_bits: int

    @property
    def sizes(self) -> tuple[int, ...]:
        """Sizes of the six streams in bytes."""
        position, rotation = 6 if self.version == 1 else 9, 4 if self.version >= 3 else 3
        harmonics = 3 * ((self.sh_degree + 1) ** 2 - 1)
        return tuple(self.count * width for width in (position, 1, 3, 3, rotation, harmonics))


def fractional_bits_for(gaussians: Gaussians, precision: Precision) -> int | None:
    """Choose the fractional bits: as few as the precision needs, and at most what the largest coordinate allows.

    Returns:
        Bits, or None if not even integers fit.
    """
    largest = float(np.abs(gaussians.means).max())
    most = next((bits for bits in range(23, -1, -1) if round(largest * 2**bits) <= MAX_FIXED), None)
    if most is None or precision.steps_in_size is None:
        return most
    # The visible size of a Gaussian is that of its larger two axes; one in ten may be smaller.
    log_size = np.percentile(np.median(gaussians.log_scales, axis=1), 10, method="lower")
    needed = np.log2(precision.steps_in_size) - float(log_size) / np.log(2)
    return int(np.clip(np.ceil(needed), 0, most))


def pack(gaussians: Gaussians, layout: Layout, precision: Precision) -> list[bytes]:
    """Encode the six streams, in the layout of versions 3 and 4."""
    scaled = (gaussians.log_scales - LOG_SCALE_ORIGIN) * LOG_SCALE_STEPS
    streams = [
        _pack_positions(gaussians.means, layout.fractional_bits),
        _to_byte(opacity_of(gaussians.opacity_logits) * OPACITY_STEPS, precision.opacity),
        _to_byte(gaussians.sh[:, 0] * COLOUR_SCALE + 127.5, precision.colour),
        _to_byte(scaled, precision.log_scale),
        pack_rotations(gaussians.quaternions, precision.rotation),
        _pack_harmonics(gaussians.sh[:, 1:], precision.harmonics),
    ]
    return [stream.tobytes() for stream in streams]


def unpack(streams: Sequence[bytes], layout: Layout) -> Gaussians:
    """Decode a scene from six streams of the layout's sizes; coefficients above degree 3 are dropped."""
    positions, opacities, colours, scales, rotations, harmonics = (np.frombuffer(s, np.uint8) for s in streams)
    count = layout.count
    sh = np.empty((count, SH_COEFFICIENTS[min(layout.sh_degree, 3)], 3), np.float32)
    sh[:, 0] = (colours.reshape(count, 3) - 127.5) / COLOUR_SCALE
    sh[:, 1:] = (harmonics.reshape(count, -1, 3)[:, : sh.shape[1] - 1].astype(np.float32) - SH_ZERO) / SH_STEPS
    return Gaussians(
        _unpack_positions(positions, layout),
        scales.reshape(count, 3) / LOG_SCALE_STEPS + LOG_SCALE_ORIGIN,
        _unpack_rotations(rotations.reshape(count, -1)),
        opacity_from_byte(opacities),
        sh,
    )


def _to_byte(numbers: np.ndarray, step: int) -> np.ndarray:
    """Round to multiples of a step as uint8, clamped to its range."""
    return np.clip(np.round(numbers / step) * step, 0, 255).astype(np.uint8)


def _pack_positions(means: np.ndarray, fractional_bits: int) -> np.ndarray:
    """(N, 3, 3) low three bytes of each coordinate, lowest first."""
    fixed = np.round(np.ldexp(means.astype(np.float64), fractional_bits)).astype("<i4")
    return fixed.view(np.uint8).reshape(-1, 3, 4)[..., :3]


def _unpack_positions(stored: np.ndarray, layout: Layout) -> np.ndarray:
    if layout.version == 1:
        return stored.view("<f2").reshape(-1, 3).astype(np.float32)
    # Stored in the upper three bytes of four, so that the right shift extends the sign.
    widened = np.zeros((layout.count * 3, 4), np.uint8)
    widened[:, 1:] = stored.reshape(-1, 3)
    fixed = widened.view("<i4").reshape(-1, 3) >> 8
    return np.ldexp(fixed.astype(np.float32), -layout.fractional_bits)


def pack_rotations(quaternions: np.ndarray, step: int) -> np.ndarray:
    """(N,) words: 2 bits for the largest of x, y, z, w, then sign and 9-bit magnitude of the others, from (N, 4).

    Magnitudes are multiples of `step`.
    """
    largest, others = drop_largest(np.roll(unit(quaternions), -1, axis=1))
    steps = np.floor(np.abs(others) / MAX_OTHER * (ROTATION_STEPS / step) + 0.5).astype(np.uint32)
    fields = ((others < 0) & (steps > 0)).astype(np.uint32) << 9 | np.minimum(steps * step, ROTATION_STEPS)
    return (largest.astype(np.uint32) << 30 | fields[:, 0] << 20 | fields[:, 1] << 10 | fields[:, 2]).astype("<u4")


def _unpack_rotations(stored: np.ndarray) -> np.ndarray:
    """(N, 4) w, x, y, z from (N, 4) bytes of versions 3 and 4, or (N, 3) of earlier ones."""
    if stored.shape[1] == 3:
        xyz = stored / 127.5 - 1.0
        w = np.sqrt(np.clip(1.0 - np.sum(xyz**2, axis=1, keepdims=True), 0.0, None))
        return unit(np.concatenate([w, xyz], axis=1))
    packed = np.ascontiguousarray(stored).view("<u4")
    fields = packed >> np.array([20, 10, 0], np.uint32)
    signs = np.where(fields & 512, -1.0, 1.0)
    others = signs * (fields & ROTATION_STEPS) * (MAX_OTHER / ROTATION_STEPS)
    return unit(np.roll(restore_largest(packed[:, 0] >> 30, others), 1, axis=1))


def _pack_harmonics(rest: np.ndarray, step: int) -> np.ndarray:
    """(N, K - 1, 3) bytes, rounded to multiples of the step around the byte that encodes 0."""
    fine = np.clip(np.round(rest * SH_STEPS), -SH_ZERO, SH_ZERO).astype(np.int32)
    return np.clip((fine + step // 2) // step * step + SH_ZERO, 0, 255).astype(np.uint8)
