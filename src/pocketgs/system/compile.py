"""How functions become machine code: one decorator for kernels, one for what they are made of.

`error_model="numpy"` lets a division by zero give infinity: a check at every division would cost more than the
division.
"""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Protocol, TypeVar

import numba

# A thread that has done its share of a kernel is to sleep until the next. OpenMP lets it spin instead, and where other
# programs need the cores too, that takes the time of those who still work: steps then took three to five times as long.
os.environ.setdefault("OMP_WAIT_POLICY", "passive")

PACKAGE = Path(__file__).parents[1]

_IMPORT = re.compile(r"^from (pocketgs\.\S+) import", re.MULTILINE)

_Function = TypeVar("_Function", bound=Callable[..., object])


class _Decorator(Protocol):
    """What it decorates keeps its type hints, so that calls are checked against them; Numba ignores them."""

    def __call__(self, function: _Function, /) -> _Function: ...


def is_compiled(room: str) -> bool:
    """Whether kernels of a package, such as `splat.cpu`, have been compiled from its sources as they are."""
    return any(_folder_of(room).rglob("*.nbc"))


def _folder_of(room: str) -> Path:
    """Where a package's machine code is kept: a folder for every state of the sources that it is made from.

    Numba itself looks only at the file of the kernel, and would run old code after a change to a part of it that stands
    in another file.
    """
    base = Path(numba.config.CACHE_DIR or PACKAGE / "__pycache__")
    return base / f"{room}-{_digest_of(room)}"


@lru_cache
def _digest_of(room: str) -> str:
    """What identifies the sources that a package's kernels are made from."""
    digest = hashlib.sha256()
    for path in _sources_of(PACKAGE.joinpath(*room.split("."))):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def _sources_of(folder: Path) -> list[Path]:
    """The modules of a package, and what those with compiled functions import: other parts, and constants."""
    modules = sorted(folder.glob("*.py"))
    sources = {*modules}
    for module in modules:
        imported = _IMPORT.findall(module.read_text(encoding="utf-8"))
        if __name__ in imported:
            sources.update(PACKAGE.parent.joinpath(*name.split(".")).with_suffix(".py") for name in imported)
    return sorted(path for path in sources if path.is_file())


def _cached(**options: bool) -> _Decorator:
    """A decorator that keeps machine code on disk for as long as no source changes."""

    def decorate(function: _Function) -> _Function:
        before = numba.config.CACHE_DIR
        # Numba reads it here, and falls back to a folder of the user's where this one cannot be written.
        room = function.__module__.removeprefix(f"{PACKAGE.name}.").rpartition(".")[0]
        numba.config.CACHE_DIR = str(_folder_of(room))
        try:
            return numba.njit(cache=True, error_model="numpy", **options)(function)
        finally:
            numba.config.CACHE_DIR = before

    return decorate


kernel: _Decorator = _cached()
"""Called from Python on one thread; its machine code is kept on disk for the next process."""

unlocked_kernel: _Decorator = _cached(nogil=True)
"""A kernel that lets other Python threads run meanwhile, for work that is dealt out to a pool of them."""

parallel_kernel: _Decorator = _cached(parallel=True)
"""A kernel whose `prange` loops run on all threads."""

part: _Decorator = numba.njit(error_model="numpy")
"""Called from kernels."""

inlined: _Decorator = numba.njit(forceinline=True, error_model="numpy")
"""Called from kernels' inner loops, always inlined: vectors stay in registers."""
