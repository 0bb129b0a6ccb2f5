"""Dynamic scheduling: threads take small pieces of work from a shared counter.

Numba gives every thread of a `prange` loop the same share. If a core is busy with another program, all threads wait for
the one that runs there. Threads that take one small piece after another lose only the work of the busy core:

    counter = first_piece()
    for _ in prange(threads):
        piece = take(counter)
        while piece < pieces:
            ...
            piece = take(counter)

Which thread does which piece varies between runs, so results must not depend on it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from pocketgs.system.compile import part

PIECE = 512
"""Gaussians per piece: large enough that taking a piece costs nothing, small enough to keep all threads busy."""


@part
def first_piece() -> np.ndarray:
    """(1,) int64: a new counter of pieces, for a kernel."""
    counter = np.empty(1, np.int64)
    counter[0] = 0
    return counter


@intrinsic
def take(typing_context: Any, counter: Any) -> Any:
    """Take the number of the next piece atomically."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        number = cgutils.create_struct_proxy(signature.args[0])(context, builder, arguments[0]).data
        return builder.atomic_rmw("add", number, ir.Constant(ir.IntType(64), 1), "monotonic")

    return types.int64(counter), generate
