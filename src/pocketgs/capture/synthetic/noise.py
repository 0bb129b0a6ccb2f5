"""Random values as functions of position, so that all views of the demo scene agree."""

from __future__ import annotations

import math

from pocketgs.system.compile import part


@part
def random_at(i: int, j: int, k: int) -> float:
    """A number in [0, 1), the same for the same integer cell."""
    mixed = (i * 73856093) ^ (j * 19349663) ^ (k * 83492791)
    # Murmur's finaliser (Appleby, 2008), in 64 bits truncated to 32: neighbouring cells must be uncorrelated.
    mixed &= 0xFFFFFFFF
    mixed = ((mixed ^ (mixed >> 16)) * 0x85EBCA6B) & 0xFFFFFFFF
    mixed = ((mixed ^ (mixed >> 13)) * 0xC2B2AE35) & 0xFFFFFFFF
    return ((mixed ^ (mixed >> 16)) & 0xFFFFFF) / 16777216.0


@part
def noise(x: float, y: float, z: float, pixel: float) -> float:
    """Smooth value noise in [0, 1]: random values at integer coordinates, interpolated.

    `pixel` is the length that a pixel covers, in cells. Below two pixels per cell the noise fades to its mean, as a
    lens would blur it.
    """
    strength = min(max(2 - 2 * pixel, 0.0), 1.0)
    if strength == 0:
        return 0.5
    i, j, k = math.floor(x), math.floor(y), math.floor(z)
    a, b, c = _eased(x - i), _eased(y - j), _eased(z - k)
    value = 0.0
    for corner in range(8):
        right, back, up = corner & 1, (corner >> 1) & 1, corner >> 2
        weight = (a if right else 1 - a) * (b if back else 1 - b) * (c if up else 1 - c)
        value += weight * random_at(i + right, j + back, k + up)
    return 0.5 + strength * (value - 0.5)


@part
def _eased(fraction: float) -> float:
    """Cubic Hermite interpolation: no creases at cell borders."""
    return fraction * fraction * (3 - 2 * fraction)
