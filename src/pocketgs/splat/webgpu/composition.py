"""Shaders put together from the files of `shaders/`.

A shader's file begins with lines `import name, name …`, which stand for the files of those names in `shaders/common`.
An imported name may be an interface with several implementations, such as `splat_words`: then the variant chosen says
which file stands for it. Numbers of the image formation, and sizes that the host must know too, are written out at the
top of every shader.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Literal

from pocketgs.splat import constants
from pocketgs.splat.reference.loss import ssim_window
from pocketgs.splat.webgpu.layout import SHARED

Access = Literal["uniform", "read", "read_write"]

_IMPORT = re.compile(r"^import (.+)$", re.MULTILINE)
_ENABLE = re.compile(r"^enable (\w+);$", re.MULTILINE)
_BINDING = re.compile(
    r"^@group\(0\) @binding\((?P<number>\d+)\) var<(?:(?P<uniform>uniform)|storage, (?P<access>\w+))> (?P<name>\w+):",
    re.MULTILINE,
)
_IMAGE_FORMATION = (
    "LOW_PASS",
    "LEAST_DETERMINANT",
    "LARGEST_VARIANCE",
    "BRIGHTEST",
    "ALPHA_MAX",
    "TRANSMITTANCE_MIN",
    "SSIM_C1",
    "SSIM_C2",
)
_LARGEST_LOG_SCALE = 40.0
"""In float32 the square of a larger one's exponential overflows. The other engines, in float64, leave that to
LARGEST_VARIANCE, under which nothing so large can be drawn."""


@dataclass(frozen=True)
class Binding:
    """What a shader reads or writes: `name` in the shader, and how."""

    name: str
    access: Access


@dataclass(frozen=True)
class Shader:
    """A shader, complete.

    Attributes:
        name: of its file.
        source: WGSL without enable directives.
        extensions: of WGSL that it needs. Browsers want them enabled by name; wgpu offers them unasked, and refuses the
            directives.
        bindings: by their numbers in group 0.
    """

    name: str
    source: str
    extensions: tuple[str, ...]
    bindings: tuple[Binding, ...]


def compose(name: str, variants: Mapping[str, str]) -> Shader:
    """Put a shader together.

    Args:
        name: of a file in `shaders/`.
        variants: from interfaces to the files in `shaders/common` that implement them.
    """
    parts: dict[str, str] = {}
    _collect(_read(name), variants, parts)
    files = [*parts.values(), _read(name)]
    extensions = dict.fromkeys(extension for text in files for extension in _ENABLE.findall(text))
    body = "\n".join(_without_directives(text) for text in files)
    return Shader(name, f"{_constants()}\n{body}", tuple(extensions), _bindings(name, body))


def _collect(text: str, variants: Mapping[str, str], parts: dict[str, str]) -> None:
    """Add what a text imports to `parts`, in order of need, each once."""
    for line in _IMPORT.findall(text):
        for imported in line.split(", "):
            name = variants.get(imported, imported)
            if name not in parts:
                part = _read(f"common/{name}")
                _collect(part, variants, parts)
                parts[name] = part


@cache
def _read(name: str) -> str:
    return (files(__package__) / "shaders" / f"{name}.wgsl").read_text(encoding="utf-8")


def _without_directives(text: str) -> str:
    kept = (line for line in text.splitlines() if not line.startswith(("import ", "enable ")))
    return "\n".join(kept) + "\n"


def _bindings(name: str, source: str) -> tuple[Binding, ...]:
    found = {int(match["number"]): match for match in _BINDING.finditer(source)}
    assert sorted(found) == list(range(len(found))), f"{name}.wgsl: bindings are not numbered from 0 on"
    return tuple(
        Binding(found[number]["name"], found[number]["uniform"] or found[number]["access"])  # type: ignore[arg-type]
        for number in range(len(found))
    )


@cache
def _constants() -> str:
    """Numbers of the image formation as WGSL."""
    values = {name: getattr(constants, name) for name in _IMAGE_FORMATION}
    values |= {"LOG2_ALPHA_MIN": math.log2(constants.ALPHA_MIN), "LOG2_E": math.log2(math.e)}
    values["LARGEST_LOG_SCALE"] = _LARGEST_LOG_SCALE
    lines = [f"const {name}: f32 = {value!r};" for name, value in values.items()]
    lines += [f"const {name}: u32 = {value}u;" for name, value in SHARED.items()]
    weights = ", ".join(repr(float(weight)) for weight in ssim_window())
    count = constants.SSIM_WINDOW
    return "\n".join([*lines, f"const SSIM_WEIGHTS: array<f32, {count}> = array<f32, {count}>({weights});", ""])
