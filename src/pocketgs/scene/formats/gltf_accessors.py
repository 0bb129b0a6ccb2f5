"""Reading of glTF accessors, with bounds checks."""

from __future__ import annotations

from typing import Any

import numpy as np

from pocketgs.errors import PocketGSError, clipped, short
from pocketgs.scene.formats.gltf_document import Document

COMPONENTS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5126: "<f4"}
WIDTHS = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}


def whole_number(value: Any, what: str) -> int:
    """Check a count, offset or index from the JSON.

    Raises:
        ValueError: it is not a whole number.
    """
    if not isinstance(value, int) or isinstance(value, bool) or value < 0:
        raise ValueError(f"{what} is {short(value)}, expected a whole number")
    return value


def item(document: Document, collection: str, index: Any) -> dict[str, Any]:
    """The object at an index in a collection of the JSON.

    Raises:
        ValueError: it does not exist.
    """
    items = document.json.get(collection, [])
    position = whole_number(index, f"an index into {collection}")
    if not isinstance(items, list) or position >= len(items) or not isinstance(items[position], dict):
        raise ValueError(f"{collection}[{position}] is missing")
    return dict(items[position])


def read_accessor(document: Document, index: Any, width: int) -> np.ndarray:
    """(N, width) float32 numbers of an accessor; normalised integers are converted to fractions.

    Raises:
        PocketGSError: the accessor exceeds its buffer, or is compressed, sparse or of another shape.
        ValueError: the JSON violates the glTF specification.
    """
    accessor = item(document, "accessors", index)
    where = f"{document.path}, accessor {index}"
    if "bufferView" not in accessor or "sparse" in accessor:
        raise PocketGSError(f"{where}: compressed or sparse, expected plain numbers in a buffer")
    kind, found = COMPONENTS.get(accessor.get("componentType", 0)), WIDTHS.get(accessor.get("type", ""))
    if kind is None or found != width:
        stated = clipped(f"{accessor.get('type')} of {accessor.get('componentType')}")
        raise PocketGSError(f"{where}: {stated}, expected {width} components of one of {list(COMPONENTS)}")
    numbers = _strided(document, accessor, np.dtype((kind, (width,))), where)
    if kind == "<f4":
        return numbers.copy()
    as_float = numbers.astype(np.float32)
    if accessor.get("normalized") is not True:
        return as_float
    return np.maximum(as_float / np.iinfo(numbers.dtype).max, -1.0)


def _strided(document: Document, accessor: dict[str, Any], element: np.dtype, where: str) -> np.ndarray:
    view = item(document, "bufferViews", accessor["bufferView"])
    if view.get("extensions"):
        raise PocketGSError(f"{where}: uses {clipped(', '.join(view['extensions']))}, expected plain numbers")
    buffer_index = whole_number(view.get("buffer"), "buffer")
    if buffer_index >= len(document.buffers):
        raise ValueError(f"buffers[{buffer_index}] is missing")
    buffer = document.buffers[buffer_index]
    count = whole_number(accessor.get("count"), "count")
    length = whole_number(view.get("byteLength"), "byteLength")
    offset = whole_number(accessor.get("byteOffset", 0), "byteOffset")
    start = whole_number(view.get("byteOffset", 0), "byteOffset") + offset
    stride = whole_number(view.get("byteStride", element.itemsize), "byteStride")
    end = offset + stride * (count - 1) + element.itemsize if count else offset
    if stride < element.itemsize or end > length or start - offset + length > len(buffer):
        raise PocketGSError(f"{where}: {short(count)} elements exceed their {short(length)} bytes in {len(buffer)}")
    base, width = element.subdtype or (element, (1,))
    return np.ndarray((count, *width), base, buffer, start, (stride, base.itemsize))
