"""How functions become machine code: one decorator for kernels, one for what they are made of.

`error_model="numpy"` lets a division by zero give infinity: a check at every division would cost more than the
division.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, TypeVar

from numba import njit

_Function = TypeVar("_Function", bound=Callable[..., object])


class _Decorator(Protocol):
    """What it decorates keeps its type hints, so that calls are checked against them; Numba ignores them."""

    def __call__(self, function: _Function, /) -> _Function: ...


kernel: _Decorator = njit(cache=True, error_model="numpy")
"""Called from Python on one thread; its machine code is kept on disk for the next process."""

parallel_kernel: _Decorator = njit(parallel=True, cache=True, error_model="numpy")
"""A kernel whose `prange` loops run on all threads."""

part: _Decorator = njit(error_model="numpy")
"""Called from kernels."""

inlined: _Decorator = njit(forceinline=True, error_model="numpy")
"""Called from kernels' inner loops, always inlined: vectors stay in registers."""
