"""Layouts of uniform buffers, read from the WGSL structs."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

_STRUCT = r"struct {name} \{{(?P<body>.*?)\n\}}"
_FIELD = re.compile(r"^ +(\w+): (\w+),$", re.MULTILINE)
_TYPES = {"f32": (np.float32, 1), "u32": (np.uint32, 1), "vec2f": (np.float32, 2), "vec4f": (np.float32, 4)}


@dataclass(frozen=True)
class UniformLayout:
    """The layout of a struct in a uniform buffer.

    Attributes:
        size: in bytes.
        fields: by name, the type and byte offset.
    """

    size: int
    fields: Mapping[str, tuple[str, int]]

    @staticmethod
    def of(struct: str, source: str) -> UniformLayout:
        """Read the layout of a struct of scalars and vectors of 2 or 4 (WGSL, section 14.4.1: alignment and size)."""
        match = re.search(_STRUCT.format(name=struct), source, re.DOTALL)
        assert match, f"no struct {struct}"
        fields, offset, widest = {}, 0, 4
        for name, kind in _FIELD.findall(match["body"]):
            size = 4 * _TYPES[kind][1]
            offset = -(-offset // size) * size
            fields[name] = (kind, offset)
            offset += size
            widest = max(widest, size)
        return UniformLayout(-(-offset // widest) * widest, fields)

    def pack(self, values: Mapping[str, ArrayLike]) -> np.ndarray:
        """Pack values into the buffer's content, (size,) uint8.

        Args:
            values: a number or a sequence of numbers per field.
        """
        assert values.keys() == self.fields.keys(), sorted(values.keys() ^ self.fields.keys())
        content = np.zeros(self.size, np.uint8)
        for name, (kind, offset) in self.fields.items():
            dtype, count = _TYPES[kind]
            content[offset : offset + 4 * count].view(dtype)[:] = values[name]
        return content

    def to_json(self) -> dict[str, object]:
        """As plain lists and dictionaries."""
        return {
            "size": self.size,
            "fields": {name: {"type": kind, "offset": offset} for name, (kind, offset) in self.fields.items()},
        }
