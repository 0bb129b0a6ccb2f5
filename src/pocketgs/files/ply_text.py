"""Reading the elements of a .ply file that is text, row by row: plyfile does it number by number, more slowly."""

from __future__ import annotations

import io
from collections.abc import Iterator
from itertools import islice
from pathlib import Path

import numpy as np
from plyfile import PlyElement, PlyProperty

BLOCK = 1 << 10
"""Rows in memory as Python's numbers."""


def text_elements(path: Path, header: bytes) -> dict[str, np.ndarray] | None:
    """Elements by name, as plyfile reads them; None if the file is binary, or has lists, which plyfile reads.

    Args:
        path: the file.
        header: of the file, without its last line.

    Raises:
        ValueError: a row is missing or has too few or too many numbers, or a word is not a number of its type.
        OSError: the file cannot be read.
    """
    elements = _elements_in(header)
    if elements is None:
        return None
    with path.open("rb") as file:
        file.seek(len(header))
        lines = io.TextIOWrapper(file, "ascii")
        lines.readline()
        return {element.name: _table(lines, element) for element in elements}


def _elements_in(header: bytes) -> list[PlyElement] | None:
    """The elements that a header states, without data; None if it is not that of a text, or not of numbers only."""
    elements: list[tuple[str, int, list[PlyProperty]]] = []
    is_text = False
    for line in header.decode("ascii", "replace").splitlines():
        match line.split():
            case ["format", "ascii", "1.0"]:
                is_text = True
            case ["element", name, count]:
                elements.append((name, int(count), []))
            case ["property", kind, name] if elements:
                elements[-1][2].append(PlyProperty(name, kind))
            case [] | ["ply"] | ["comment" | "obj_info", *_]:
                pass
            case _:
                return None
    return [PlyElement(name, properties, count) for name, count, properties in elements] if is_text else None


def _table(lines: io.TextIOWrapper, element: PlyElement) -> np.ndarray:
    """The rows of an element, which are the next lines."""
    table = np.empty(element.count, element.dtype())
    rows = _rows(lines, element)
    for start in range(0, element.count, BLOCK):
        block = table[start : start + BLOCK]
        numbers = np.array(list(islice(rows, len(block))), np.float64)
        for place, name in enumerate(block.dtype.names or ()):
            block[name] = _typed(numbers[:, place], block.dtype[name], name)
    return table


def _rows(lines: io.TextIOWrapper, element: PlyElement) -> Iterator[list[float]]:
    """The numbers of each row."""
    width = len(element.properties)
    for number in range(element.count):
        line = lines.readline()
        if not line:
            raise ValueError(f"cut short: {number} rows of element {element.name!r}, expected {element.count}")
        words = line.split()
        if len(words) != width:
            raise ValueError(f"row {number} of element {element.name!r} has {len(words)} words, expected {width}")
        try:
            yield [float(word) for word in words]
        except ValueError as error:
            raise ValueError(f"row {number} of element {element.name!r}: {error}") from error


def _typed(numbers: np.ndarray, kind: np.dtype, name: str) -> np.ndarray:
    """Numbers in the type of their property; those beyond a type of fractions become infinite."""
    with np.errstate(over="ignore", invalid="ignore"):
        typed = numbers.astype(kind)
    if kind.kind in "iu" and not np.array_equal(typed, numbers):
        raise ValueError(f"property {name!r} holds a number that is no {kind.name}")
    return typed
