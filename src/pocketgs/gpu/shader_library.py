"""Shaders linked from WGSL files that import each other.

A line `import name, name …` stands for the files of those names in a folder's `common/`. A file may hold more than one
shader needs: a line `section name` begins a section of it, imported as `file.name`. What stands before the first
section comes with every one of them.

An imported name may be an interface with several implementations, such as `splats.words`: then the chosen variants say
which section stands for it. Constants that the host must know too are written out at the top of every shader.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Literal

from pocketgs.gpu.workgroups import CONSTANTS

Access = Literal["uniform", "read", "read_write"]
SHADERS = Path(__file__).parent / "shaders"

Constant = int | float | Sequence[float]

_IMPORT = re.compile(r"^import (.+)$", re.MULTILINE)
_ENABLE = re.compile(r"^enable (\w+);$", re.MULTILINE)
_SECTION = re.compile(r"^section (\w+)\n", re.MULTILINE)
_BINDING = re.compile(
    r"^@group\(0\) @binding\((?P<number>\d+)\) var<(?:(?P<uniform>uniform)|storage, (?P<access>\w+))> (?P<name>\w+):",
    re.MULTILINE,
)


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


class ShaderLibrary:
    """The shaders of a folder, and the general ones of this package.

    Args:
        folder: of `.wgsl` files, a shader each; what they import is in its `common/` or this package's.
        constants: by name: u32, f32, or arrays of f32; those of `workgroups` come with them.
    """

    def __init__(self, folder: Path, constants: Mapping[str, Constant]) -> None:
        self._folders = (SHADERS, folder)
        self._constants = "".join(_declaration(*item) for item in {**CONSTANTS, **constants}.items())

    def link(self, name: str, variants: Mapping[str, str]) -> Shader:
        """Put a shader together.

        Args:
            name: of its file.
            variants: from interfaces to the sections that implement them.

        Raises:
            ValueError: a file or section is missing, or bindings are not numbered from 0 on.
        """
        if name not in self._shaders:
            raise ValueError(f"shader {name!r}: not found, expected one of {', '.join(self._shaders)}")
        parts: dict[str, str] = {}
        self._collect(self._shaders[name], variants, parts)
        texts = [*parts.values(), self._shaders[name]]
        extensions = dict.fromkeys(extension for text in texts for extension in _ENABLE.findall(text))
        body = "\n".join(_without_directives(text) for text in texts)
        return Shader(name, f"{self._constants}\n{body}", tuple(extensions), _bindings(name, body))

    @cached_property
    def sections(self) -> dict[str, str]:
        """What can be imported, by name: the beginnings of files, and their sections."""
        sections = {}
        for file, text in _texts(folder / "common" for folder in self._folders).items():
            sections[file], *parts = _SECTION.split(text)
            sections |= {f"{file}.{name}": part for name, part in zip(parts[::2], parts[1::2], strict=True)}
        return sections

    @cached_property
    def _shaders(self) -> dict[str, str]:
        return _texts(self._folders)

    def _collect(self, text: str, variants: Mapping[str, str], parts: dict[str, str]) -> None:
        """Add what a text imports to `parts`, in order of need, each once."""
        for line in _IMPORT.findall(text):
            for imported in line.split(", "):
                section = variants.get(imported, imported)
                self._add(section.partition(".")[0], variants, parts)
                self._add(section, variants, parts)

    def _add(self, section: str, variants: Mapping[str, str], parts: dict[str, str]) -> None:
        if section not in self.sections:
            raise ValueError(f"import {section}: not found, expected one of {', '.join(self.sections)}")
        if section not in parts:
            self._collect(self.sections[section], variants, parts)
            parts[section] = self.sections[section]


def _texts(folders: Iterable[Path]) -> dict[str, str]:
    """The `.wgsl` files of folders, by name without suffix."""
    paths = [path for folder in folders for path in sorted(folder.glob("*.wgsl"))]
    return {path.stem: path.read_text(encoding="utf-8") for path in paths}


def _without_directives(text: str) -> str:
    kept = (line for line in text.splitlines() if not line.startswith(("import ", "enable ")))
    return "\n".join(kept) + "\n"


def _bindings(name: str, source: str) -> tuple[Binding, ...]:
    found = {int(match["number"]): match for match in _BINDING.finditer(source)}
    if sorted(found) != list(range(len(found))):
        raise ValueError(f"shader {name!r}: found bindings {sorted(found)}, expected numbers from 0 on")
    return tuple(
        Binding(found[number]["name"], found[number]["uniform"] or found[number]["access"])  # type: ignore[arg-type]
        for number in range(len(found))
    )


def _declaration(name: str, value: Constant) -> str:
    """A constant as WGSL."""
    if isinstance(value, int):
        return f"const {name}: u32 = {value}u;\n"
    if isinstance(value, float):
        return f"const {name}: f32 = {value!r};\n"
    numbers = ", ".join(repr(float(number)) for number in value)
    return f"const {name}: array<f32, {len(value)}> = array<f32, {len(value)}>({numbers});\n"
