"""Vectorised exponentials: 2^x for falloffs, e^x for scales."""

from __future__ import annotations

import math

import numpy as np
from numba.extending import overload

from pocketgs.splat.cpu.lanes import Floats, select, times_power_of_two, truncate

# Minimax polynomial of 2^f on [-1, 0]; its relative error is 7.5e-8, about float32's precision.
_C0, _C1, _C2, _C3, _C4, _C5 = (
    np.float32(coefficient)
    for coefficient in (0.99999992506, 0.69314225246, 0.24017218828, 0.05527971900, 0.00918860889, 0.00093878724)
)
_LOWEST, _HIGHEST = np.float32(-126.0), np.float32(127.0)
_ONE, _LOG2_E = np.float32(1.0), np.float32(1.0 / math.log(2.0))


def exp2_of_negative(x: Floats) -> Floats:
    """2^x per lane for x <= 0, in kernels only. Below -126, and for NaN, it is 2^-126."""
    raise NotImplementedError("for kernels only")


@overload(exp2_of_negative, inline="always")
def _exp2_of_negative(x):
    def implementation(x):
        bounded = max(x, _LOWEST)
        whole = truncate(bounded)
        f = bounded - whole
        power = _C0 + f * (_C1 + f * (_C2 + f * (_C3 + f * (_C4 + f * _C5))))
        return times_power_of_two(power, whole)

    return implementation


def exp(x: Floats) -> Floats:
    """e^x per lane, in kernels only, clamped to 2^-126 and 2^127."""
    raise NotImplementedError("for kernels only")


@overload(exp, inline="always")
def _exp(x):
    def implementation(x):
        bounded = min(max(x * _LOG2_E, _LOWEST), _HIGHEST)
        whole = truncate(bounded)
        whole = select(whole < bounded, whole + _ONE, whole)
        f = bounded - whole
        power = _C0 + f * (_C1 + f * (_C2 + f * (_C3 + f * (_C4 + f * _C5))))
        return times_power_of_two(power, whole)

    return implementation
