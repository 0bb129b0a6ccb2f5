"""Declarations of a shader: its constants, threads and workgroup memory (WGSL, section 14.4.1)."""

from __future__ import annotations

import math
import re

_SCALARS = {"f32": 4, "u32": 4, "i32": 4, "bool": 4}
_STRUCT = re.compile(r"^struct (\w+) \{(.*?)^\}", re.MULTILINE | re.DOTALL)
_FIELD = re.compile(r"^ +\w+: (.+),$", re.MULTILINE)
_CONSTANT = re.compile(r"^const (\w+): u32 = (.+);", re.MULTILINE)
_WORKGROUP_SIZE = re.compile(r"@workgroup_size\(([^)]+)\)")
_NAME = re.compile(r"[A-Z][A-Z0-9_]*")
_ALIAS = re.compile(r"^alias (\w+) = (.+);", re.MULTILINE)
_WORKGROUP = re.compile(r"^var<workgroup> \w+: (.+);", re.MULTILINE)


def workgroup_bytes(source: str) -> int:
    """Bytes of all `var<workgroup>` of a shader."""
    return sum(_up(_Types(source).layout(kind)[1], 16) for kind in _WORKGROUP.findall(source))


def workgroup_size(source: str) -> int:
    """Threads of a shader's workgroup."""
    (size,) = _WORKGROUP_SIZE.findall(source)
    return math.prod(_Types(source).number(side) for side in size.split(", "))


def constant(name: str, source: str) -> int:
    """Value of one of a shader's u32 constants."""
    return _Types(source).number(name)


class _Types:
    """The types that a shader defines."""

    def __init__(self, source: str) -> None:
        self._structs = {name: _FIELD.findall(body) for name, body in _STRUCT.findall(source)}
        self._constants = dict(_CONSTANT.findall(source))
        self._aliases = dict(_ALIAS.findall(source))

    def layout(self, kind: str) -> tuple[int, int]:
        """Alignment and size in bytes."""
        if kind in _SCALARS:
            return 4, 4
        if match := re.fullmatch(r"vec([234])[fui]", kind):
            length = int(match[1])
            return 4 * (2 if length == 2 else 4), 4 * length
        if match := re.fullmatch(r"atomic<(\w+)>", kind):
            return self.layout(match[1])
        if match := re.fullmatch(r"array<(.+), ([\w *]+)>", kind):
            alignment, size = self.layout(match[1])
            return alignment, self.number(match[2]) * _up(size, alignment)
        if kind in self._aliases:
            return self.layout(self._aliases[kind])
        widest, end = 4, 0
        for field in self._structs[kind]:
            alignment, size = self.layout(field)
            widest, end = max(widest, alignment), _up(end, alignment) + size
        return widest, _up(end, widest)

    def number(self, text: str) -> int:
        """A literal, a constant by name, or what is computed from such."""
        numbers = _NAME.sub(lambda name: f"({self.number(self._constants[name[0]])})", text)
        return int(eval(re.sub(r"(\d)u\b", r"\1", numbers).replace("/", "//")))


def _up(size: int, multiple: int) -> int:
    return -(-size // multiple) * multiple
