"""2^x on vectors, for the exponents of falloffs."""

from __future__ import annotations

import numpy as np
from numba.extending import overload

from pocketgs.splat.cpu.lanes import Floats, times_power_of_two, truncate

# Minimax polynomial of 2^f on [-1, 0]; its relative error is 7.5e-8, about float32's own.
_C0, _C1, _C2, _C3, _C4, _C5 = (
    np.float32(coefficient)
    for coefficient in (0.99999992506, 0.69314225246, 0.24017218828, 0.05527971900, 0.00918860889, 0.00093878724)
)
_LOWEST = np.float32(-126.0)


def exp2_of_negative(x: Floats) -> Floats:
    """2^x lane by lane for x <= 0, in kernels only. Below -126, and where x is not a number, it is 2^-126."""
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
