"""Work dealt out to threads as they come for it.

Numba gives every thread of a `prange` loop the same share of it. Where a core is busy with something else, all the
others then wait for the thread that runs there. A kernel whose threads take one small piece after the other loses only
what the busy core does not do:

    counter = first_piece()
    for _ in prange(threads):
        piece = take(counter)
        while piece < pieces:
            ...
            piece = take(counter)

Who works on which piece changes from run to run, so no piece may depend on another, nor on who does it.
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
"""Gaussians in a piece of work: enough that taking it costs nothing, few enough to keep all threads busy to the end."""


@part
def first_piece() -> np.ndarray:
    """(1,) int64: a counter of pieces, for kernels."""
    counter = np.empty(1, np.int64)
    counter[0] = 0
    return counter


@intrinsic
def take(typing_context: Any, counter: Any) -> Any:
    """The number of the next piece; no two threads get the same."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        number = cgutils.create_struct_proxy(signature.args[0])(context, builder, arguments[0]).data
        return builder.atomic_rmw("add", number, ir.Constant(ir.IntType(64), 1), "monotonic")

    return types.int64(counter), generate
