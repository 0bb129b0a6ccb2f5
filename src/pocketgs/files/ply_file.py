"""Reading the elements of a .ply file."""

from __future__ import annotations

import io
import os
from pathlib import Path

import numpy as np
from plyfile import PlyData

from pocketgs.errors import PocketGSError, clipped
from pocketgs.files.memory_bound import require_memory
from pocketgs.files.opening import checked
from pocketgs.files.ply_header import MAX_HEADER_BYTES, header_in
from pocketgs.files.ply_text import text_elements

LIST_BYTES = 20
"""Memory per byte of a file with lists, such as a mesh's triangles: each becomes an object."""

AS_ASCII = bytes(range(128)) + b"?" * 128
"""Table that replaces bytes beyond ASCII."""


def read_vertices(path: Path) -> np.ndarray:
    """(N,) structured array of the vertices of a .ply file; list properties become objects.

    Raises:
        PocketGSError: the file is missing, broken, or has no vertices.
    """
    elements = read_elements(path)
    if "vertex" not in elements:
        raise PocketGSError(f"{path}: not a readable .ply with vertices: holds {', '.join(elements) or 'nothing'}")
    return elements["vertex"]


def read_elements(path: Path) -> dict[str, np.ndarray]:
    """Elements of a .ply file by name, each an (N,) structured array; list properties become objects.

    Raises:
        PocketGSError: the file is missing or broken, or its lists exceed the memory bound. What has none is mapped to
            memory, or text, which takes no more than the file.
    """
    try:
        if not checked(path).is_file():
            raise PocketGSError(f"{path}: no such file, expected a .ply")
        header = _checked_header(path)
        if b"property list" in header:
            require_memory(path, LIST_BYTES * path.stat().st_size, "its lists")
        if (elements := text_elements(path, header)) is not None:
            return elements
        if header.isascii():
            return {element.name: element.data for element in PlyData.read(str(path)).elements}
        with _PlainHeader(path, len(header)) as stream:
            return {element.name: element.data for element in PlyData.read(stream).elements}
    except PocketGSError:
        raise
    except Exception as error:  # plyfile raises all kinds of errors
        raise PocketGSError(f"{path}: not a readable .ply ({clipped(error)})") from error


def read_comments(path: Path) -> list[str]:
    """The comments of a .ply file's header; none where it has no header.

    Raises:
        PocketGSError: the file is missing.
    """
    if not checked(path).is_file():
        raise PocketGSError(f"{path}: no such file, expected a .ply")
    with path.open("rb") as file:
        header = header_in(file.read(MAX_HEADER_BYTES))
    lines = (header or b"").decode("ascii", "replace").splitlines()
    return [line.removeprefix("comment ").strip() for line in lines if line.startswith("comment ")]


class _PlainHeader(io.BufferedReader):
    """A .ply file whose header reads as ASCII, as plyfile expects: comments may hold other text.

    Each byte becomes one, so that places in the file stay the same, and it can be mapped to memory.
    """

    def __init__(self, path: Path, size: int) -> None:
        super().__init__(io.FileIO(path))
        self._size = size

    def read(self, size: int | None = -1, /) -> bytes:
        inside = max(self._size - self.tell(), 0)
        found = super().read(size)
        return found[:inside].translate(AS_ASCII) + found[inside:] if inside else found


def _checked_header(path: Path) -> bytes:
    """The header up to its end, unless it states more than the file holds: plyfile allocates before it reads.

    Raises:
        PocketGSError: the file is shorter than its header states, or the header has no end.
    """
    with path.open("rb") as file:
        header = header_in(file.read(MAX_HEADER_BYTES))
        size = file.seek(0, os.SEEK_END)
    if header is None:
        raise PocketGSError(f"{path}: not a .ply: no end_header in its first {MAX_HEADER_BYTES} bytes")
    elements: list[list[int]] = []
    for words in map(bytes.split, header.splitlines()):
        if words[:1] == [b"element"]:
            elements.append([max(int(words[2]), 0), 0])
        elif words[:1] == [b"property"]:
            elements[-1][1] += 1
    # A row takes at least one byte per property.
    least_bytes = sum(rows * max(properties, 1) for rows, properties in elements)
    if least_bytes > size:
        raise PocketGSError(f"{path}: cut short: {size} bytes, but its header states at least {least_bytes}")
    return header
