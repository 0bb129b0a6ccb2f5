"""Decorators that compile kernels with Numba, and the cache of their machine code.

`error_model="numpy"` makes a division by zero return infinity: a check at every division would cost more than the
division itself.
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
from numba.extending import register_jitable

# A thread that has finished its share of a kernel should sleep until the next. OpenMP makes it spin by default, which
# takes time from working threads when other programs need the cores: steps then took three to five times as long.
os.environ.setdefault("OMP_WAIT_POLICY", "passive")

PACKAGE = Path(__file__).parents[1]

_IMPORT = re.compile(r"^from (pocketgs\.\S+) import", re.MULTILINE)

_COMPILES = re.compile(r"^from (numba|pocketgs\.system\.compile)\b", re.MULTILINE)

_Function = TypeVar("_Function", bound=Callable[..., object])


class _Decorator(Protocol):
    """A decorator that keeps type hints, so that mypy checks calls; Numba ignores them."""

    def __call__(self, function: _Function, /) -> _Function: ...


def is_compiled(package: str) -> bool:
    """Whether the kernels of a package, such as `splat.cpu`, are compiled and up to date."""
    return any(folder_of(package).rglob("*.nbc"))


def folder_of(package: str) -> Path:
    """Cache folder for a package's machine code: one folder per state of its sources.

    Numba itself checks only the kernel's own file, and would run stale code after a change in an imported file.
    """
    base = Path(numba.config.CACHE_DIR or PACKAGE / "__pycache__")
    return base / f"{package}-{_digest_of(package)}"


@lru_cache
def _digest_of(package: str) -> str:
    """Digest of the sources that a package's kernels are made from."""
    digest = hashlib.sha256()
    for path in _sources_of(PACKAGE.joinpath(*package.split("."))):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def _sources_of(folder: Path) -> list[Path]:
    """The modules of a package, and those that the ones with compiled functions import in turn."""
    found: set[Path] = set()
    left = list(folder.glob("*.py"))
    while left:
        module = left.pop()
        if module in found or not module.is_file():
            continue
        found.add(module)
        source = module.read_text(encoding="utf-8")
        for name in _IMPORT.findall(source) if _COMPILES.search(source) else ():
            imported = PACKAGE.parent.joinpath(*name.split("."))
            left += imported.glob("*.py") if imported.is_dir() else [imported.with_suffix(".py")]
    return sorted(found)


def _cached(**options: bool) -> _Decorator:
    """Make a decorator that caches machine code on disk until a source changes."""

    def decorate(function: _Function) -> _Function:
        before = numba.config.CACHE_DIR
        # Numba reads this here, and falls back to a folder in the user's cache if it is not writable.
        package = function.__module__.removeprefix(f"{PACKAGE.name}.").rpartition(".")[0]
        numba.config.CACHE_DIR = str(folder_of(package))
        try:
            return numba.njit(cache=True, error_model="numpy", no_cfunc_wrapper=True, **options)(function)
        finally:
            numba.config.CACHE_DIR = before

    return decorate


kernel: _Decorator = _cached()
"""For functions called from Python on one thread; cached on disk."""

unlocked_kernel: _Decorator = _cached(nogil=True)
"""For kernels that release the GIL, so that a thread pool can run them in parallel."""

parallel_kernel: _Decorator = _cached(parallel=True)
"""For kernels whose `prange` loops run on all threads."""

PART = {"error_model": "numpy", "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
"""Options of functions called from kernels only. Entries from Python and C would take a third of the compile time."""

INLINED = {**PART, "forceinline": True}
"""Options of functions that are always inlined into kernels."""

part: _Decorator = register_jitable(**PART)
"""For functions called from kernels. Called from Python, they run uncompiled."""

inlined: _Decorator = register_jitable(**INLINED)
"""For functions called from kernels' inner loops: always inlined, so that vectors stay in registers."""
