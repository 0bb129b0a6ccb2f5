"""Notes of the variants that a package's kernels are compiled for, beside their machine code.

Numba compiles a kernel anew for other types of arguments, such as another lens, and its files do not tell which.
"""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

from pocketgs.system.compile import folder_of


def note_compiled(package: str, variant: str) -> None:
    """Note that the kernels of a package, such as `splat.cpu`, are compiled for a variant, until a source changes."""
    note = _note_of(package, variant)
    with suppress(OSError):  # where nothing can be written, Numba keeps machine code elsewhere
        note.parent.mkdir(parents=True, exist_ok=True)
        note.touch()


def is_compiled_for(package: str, variant: str) -> bool:
    """Whether that was noted."""
    return _note_of(package, variant).exists()


def _note_of(package: str, variant: str) -> Path:
    return folder_of(package) / f"{variant}.compiled"
