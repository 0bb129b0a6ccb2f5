"""Square roots, angles and selection for numbers and for vectors, so that both passes share a lens's formulas."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba.extending import overload

from pocketgs.splat.constants import ARCTANGENT
from pocketgs.splat.cpu.lanes import FLOATS, Floats, broadcast, magnitude, select, square_root
from pocketgs.system.compile import INLINED

_ATAN = tuple(map(np.float32, ARCTANGENT))
_RIGHT, _STRAIGHT = np.float32(math.pi / 2), np.float32(math.pi)


def root(x: Floats) -> Floats:
    """√x, in kernels only."""
    raise NotImplementedError("for kernels only")


def where(condition: Any, yes: Floats, no: Floats) -> Floats:
    """`yes` where the condition is true, otherwise `no`, which may be a number beside vectors; in kernels only."""
    raise NotImplementedError("for kernels only")


def angle(y: Floats, x: Floats) -> Floats:
    """atan2(y, x) for y >= 0, not both 0, in kernels only."""
    raise NotImplementedError("for kernels only")


@overload(root, jit_options=INLINED)
def _root(x):
    if x == FLOATS:
        return lambda x: square_root(x)
    return lambda x: math.sqrt(x)


@overload(where, jit_options=INLINED)
def _where(condition, yes, no):
    if yes == FLOATS and no != FLOATS:
        return lambda condition, yes, no: select(condition, yes, broadcast(np.float32(no)))
    if yes == FLOATS:
        return lambda condition, yes, no: select(condition, yes, no)
    return lambda condition, yes, no: yes if condition else no


@overload(angle, jit_options=INLINED)
def _angle(y, x):
    if y != FLOATS:
        return lambda y, x: math.atan2(y, x)

    def implementation(y, x):
        across = magnitude(x)
        steep = across < y
        t = select(steep, across, y) / select(steep, y, across)
        u = t * t
        c0, c1, c2, c3, c4, c5, c6, c7, c8, c9 = _ATAN
        upper = c5 + u * (c6 + u * (c7 + u * (c8 + u * c9)))
        found = t * (c0 + u * (c1 + u * (c2 + u * (c3 + u * (c4 + u * upper)))))
        found = select(steep, _RIGHT - found, found)
        return select(x < broadcast(np.float32(0.0)), _STRAIGHT - found, found)

    return implementation
