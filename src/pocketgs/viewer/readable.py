"""Scene files that the page can read, and conversion of those that it cannot."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from pocketgs.scene.formats.antialiased import MARK
from pocketgs.scene.formats.marked import is_antialiased
from pocketgs.scene.formats.ply import write_gaussians
from pocketgs.scene.gaussians import Gaussians

MAX_PLY_HEADER_BYTES = 1 << 16

_END = re.compile(rb"^end_header\r?\n", re.MULTILINE)
"""Last line of a header, as the page looks for it."""


@contextmanager
def readable_file(path: Path, write: Callable[[Path], None]) -> Iterator[Path]:
    """The scene's own file if the page can read it, otherwise a temporary `.ply` copy while the block runs.

    Args:
        path: the file.
        write: writes what is in it to another file.

    Raises:
        PocketGSError: the copy cannot be written.
    """
    if _is_readable(path):
        yield path
        return
    with TemporaryDirectory(prefix="pocketgs-") as folder:
        copy = Path(folder) / "scene.ply"
        write(copy)
        yield copy


def write_copy(copy: Path, gaussians: Gaussians, original: Path) -> None:
    """Write a `.ply` copy of a scene, with the mark of anti-aliasing that its file has: the page tells of it.

    Raises:
        PocketGSError: the copy cannot be written, or the file cannot be read.
    """
    write_gaussians(copy, gaussians, comments=[MARK] if is_antialiased(original) else [])


def _is_readable(path: Path) -> bool:
    if path.suffix.lower() != ".ply":
        return path.suffix.lower() in (".pgs", ".splat", ".spz")
    with path.open("rb") as file:
        return _is_plain_ply(file.read(MAX_PLY_HEADER_BYTES))


def _is_plain_ply(start: bytes) -> bool:
    """Whether a .ply has the layout of the reference implementation: rows of 32-bit floats only."""
    end = _END.search(start)
    if not end:
        return False
    lines = [line.split() for line in start[: end.start()].split(b"\n")]
    properties = [words for words in lines if words[:1] == [b"property"]]
    elements = [words[1] for words in lines if words[:1] == [b"element"] and len(words) > 1]
    is_float = all(words[1:2] in ([b"float"], [b"float32"]) for words in properties)
    has_gaussians = any(words[2:] == [b"f_dc_0"] for words in properties)
    is_little = [b"format", b"binary_little_endian", b"1.0"] in lines
    return elements == [b"vertex"] and is_float and is_little and has_gaussians
