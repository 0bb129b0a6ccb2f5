"""The numbers of a `.spz`: what each attribute is rounded to, and how many bytes that takes.

Six streams stand one after the other, each with all Gaussians: positions (24-bit fixed point), opacities, colours,
log scales (8 bits a number), rotations, and spherical harmonics (8 bits a coefficient, red, green, blue innermost).
Values are in the file's own axes here.
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
"""Bytes a unit of the coefficient of degree 0: less than the visible range needs, so that colours may leave it."""

LOG_SCALE_ORIGIN, LOG_SCALE_STEPS = -10.0, 16.0
SH_STEPS, SH_ZERO = 128.0, 128
ROTATION_STEPS = 511
"""Of each of three components' 9-bit magnitude."""


@dataclass(frozen=True)
class Layout:
    """What the header says about the streams.

    Attributes:
        version: 1 to 4.
        count: number of Gaussians.
        sh_degree: 0 to 4; one more than we keep.
        fractional_bits: of the positions' fixed point.
    """

    version: int
    count: int
    sh_degree: int
    fractional_bits: int

    @property
    def sizes(self) -> tuple[int, ...]:
        """Bytes of each of the six streams."""
        position, rotation = 6 if self.version == 1 else 9, 4 if self.version >= 3 else 3
        harmonics = 3 * ((self.sh_degree + 1) ** 2 - 1)
        return tuple(self.count * width for width in (position, 1, 3, 3, rotation, harmonics))


def fractional_bits_for(gaussians: Gaussians, precision: Precision) -> int | None:
    """As few as the precision asks for, at most as many as leave the 24 bits room for the largest coordinate.

    Returns:
        Bits, or None where not even whole numbers fit.
    """
    largest = float(np.abs(gaussians.means).max())
    most = next((bits for bits in range(23, -1, -1) if round(largest * 2**bits) <= MAX_FIXED), None)
    if most is None or precision.steps_in_size is None:
        return most
    # What shows of a Gaussian has the size of its larger two axes; one in ten may be smaller.
    log_size = np.percentile(np.median(gaussians.log_scales, axis=1), 10, method="lower")
    needed = np.log2(precision.steps_in_size) - float(log_size) / np.log(2)
    return int(np.clip(np.ceil(needed), 0, most))


def pack(gaussians: Gaussians, layout: Layout, precision: Precision) -> list[bytes]:
    """The six streams, in the layout of version 3 and 4."""
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
    """The scene in six streams of the sizes that the layout gives; coefficients above degree 3 are dropped."""
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
    """uint8 nearest to the numbers among the multiples of a step; those out of its range are moved to its ends."""
    return np.clip(np.round(numbers / step) * step, 0, 255).astype(np.uint8)


def _pack_positions(means: np.ndarray, fractional_bits: int) -> np.ndarray:
    """(N, 3, 3) the low three bytes of each coordinate, lowest first."""
    fixed = np.round(np.ldexp(means.astype(np.float64), fractional_bits)).astype("<i4")
    return fixed.view(np.uint8).reshape(-1, 3, 4)[..., :3]


def _unpack_positions(stored: np.ndarray, layout: Layout) -> np.ndarray:
    if layout.version == 1:
        return stored.view("<f2").reshape(-1, 3).astype(np.float32)
    # In the upper three bytes of four, a shift down brings the sign along.
    widened = np.zeros((layout.count * 3, 4), np.uint8)
    widened[:, 1:] = stored.reshape(-1, 3)
    fixed = widened.view("<i4").reshape(-1, 3) >> 8
    return np.ldexp(fixed.astype(np.float32), -layout.fractional_bits)


def pack_rotations(quaternions: np.ndarray, step: int) -> np.ndarray:
    """(N,) 2 bits for the largest of x, y, z, w, then sign and 9-bit magnitude of each of the others, from (N, 4).

    Magnitudes are multiples of `step`.
    """
    largest, others = drop_largest(np.roll(unit(quaternions), -1, axis=1))
    steps = np.floor(np.abs(others) / MAX_OTHER * (ROTATION_STEPS / step) + 0.5).astype(np.uint32)
    fields = ((others < 0) & (steps > 0)).astype(np.uint32) << 9 | np.minimum(steps * step, ROTATION_STEPS)
    return (largest.astype(np.uint32) << 30 | fields[:, 0] << 20 | fields[:, 1] << 10 | fields[:, 2]).astype("<u4")


def _unpack_rotations(stored: np.ndarray) -> np.ndarray:
    """(N, 4) w, x, y, z from (N, 4) bytes of version 3 and 4, or (N, 3) of the versions before."""
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
    """(N, K - 1, 3) bytes, each the nearest multiple of the step away from that of 0."""
    fine = np.clip(np.round(rest * SH_STEPS), -SH_ZERO, SH_ZERO).astype(np.int32)
    return np.clip((fine + step // 2) // step * step + SH_ZERO, 0, 255).astype(np.uint8)
