"""A linker for WGSL files that import each other.

A line `import name, name …` is replaced by the files of those names in a folder's `common/`. A file can have several
sections: a line `section name` starts one, which is imported as `file.name`. The part before the first section comes
with each of them.

An imported name can be an interface with several implementations, such as `splats.words`: the chosen variants say which
section to use. Constants that the host also needs are written at the top of each shader that uses them.
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
_WORD = re.compile(r"\w+")
_ENABLE = re.compile(r"^enable (\w+);$", re.MULTILINE)
_SECTION = re.compile(r"^section (\w+)\n", re.MULTILINE)
_BINDING = re.compile(
    r"^@group\(0\) @binding\((?P<number>\d+)\) var<(?:(?P<uniform>uniform)|storage, (?P<access>\w+))> (?P<name>\w+):",
    re.MULTILINE,
)


@dataclass(frozen=True)
class Binding:
    """A binding of a shader: its `name` and access."""

    name: str
    access: Access


@dataclass(frozen=True)
class Shader:
    """A linked shader.

    Attributes:
        name: of its file.
        source: WGSL without enable directives.
        extensions: WGSL extensions that it needs. Browsers require an enable directive for each; wgpu enables them
            itself and rejects the directives.
        bindings: of group 0, by number.
    """

    name: str
    source: str
    extensions: tuple[str, ...]
    bindings: tuple[Binding, ...]


class ShaderLibrary:
    """The shaders of a folder, with this package's general ones.

    Args:
        folder: of `.wgsl` files, one per shader; imports are looked up in its `common/` and in this package's.
        constants: by name: u32, f32, or arrays of f32; those of `workgroups` are added.
    """

    def __init__(self, folder: Path, constants: Mapping[str, Constant]) -> None:
        self._folders = (SHADERS, folder)
        self._constants = {name: _declaration(name, value) for name, value in {**CONSTANTS, **constants}.items()}

    def link(self, name: str, variants: Mapping[str, str]) -> Shader:
        """Link a shader.

        Args:
            name: of its file.
            variants: from interfaces to the sections that implement them.

        Raises:
            ValueError: a file or section is missing, or bindings are not numbered from 0.
        """
        if name not in self._shaders:
            raise ValueError(f"shader {name!r}: not found, expected one of {', '.join(self._shaders)}")
        parts: dict[str, str] = {}
        self._collect(self._shaders[name], variants, parts)
        texts = [*parts.values(), self._shaders[name]]
        extensions = dict.fromkeys(extension for text in texts for extension in _ENABLE.findall(text))
        body = "\n".join(_without_directives(text) for text in texts)
        used = set(_WORD.findall(body))
        constants = "".join(text for constant, text in self._constants.items() if constant in used)
        return Shader(name, f"{constants}\n{body}", tuple(extensions), _bindings(name, body))

    @cached_property
    def sections(self) -> dict[str, str]:
        """All importable texts by name: files up to their first section, and sections."""
        sections = {}
        for file, text in _texts(folder / "common" for folder in self._folders).items():
            sections[file], *parts = _SECTION.split(text)
            sections |= {f"{file}.{name}": part for name, part in zip(parts[::2], parts[1::2], strict=True)}
        return sections

    @cached_property
    def _shaders(self) -> dict[str, str]:
        return _texts(self._folders)

    def _collect(self, text: str, variants: Mapping[str, str], parts: dict[str, str]) -> None:
        """Add the imports of a text to `parts`, dependencies first, each once."""
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
    """The `.wgsl` files of some folders, by name without suffix."""
    paths = [path for folder in folders for path in sorted(folder.glob("*.wgsl"))]
    return {path.stem: path.read_text(encoding="utf-8") for path in paths}


def _without_directives(text: str) -> str:
    kept = (line for line in text.splitlines() if not line.startswith(("import ", "enable ")))
    return "\n".join(kept) + "\n"


def _bindings(name: str, source: str) -> tuple[Binding, ...]:
    found = {int(match["number"]): match for match in _BINDING.finditer(source)}
    if sorted(found) != list(range(len(found))):
        raise ValueError(f"shader {name!r}: found bindings {sorted(found)}, expected numbers from 0")
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
