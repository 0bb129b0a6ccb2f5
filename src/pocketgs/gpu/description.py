"""Passes as data: everything that a WebGPU host, in Python or in a browser, needs to run them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from pocketgs.gpu.shader_library import Shader
from pocketgs.gpu.sizes import Symbols, evaluate
from pocketgs.gpu.uniforms import UniformLayout

VERSION = 2

MIN_BUFFER = 16
"""Size in bytes of buffers that are not used: WebGPU allows no empty ones."""


@dataclass(frozen=True)
class Pass:
    """One dispatch of a shader.

    Attributes:
        name: for people; several passes may run one shader.
        shader: name of the shader.
        groups: number of workgroups, an expression; the host folds it into rows of at most 65,535. None if the GPU
            computes it: then `indirect` says where.
        indirect: a buffer and the byte offset of the dispatch's three sizes in it.
        buffers: maps the shader's binding names to buffers, where they differ.
        constants: values of the shader's overrides.
        when: an expression; the pass is skipped if it is 0.
    """

    name: str
    shader: str
    groups: str | None = None
    indirect: tuple[str, int] | None = None
    buffers: Mapping[str, str] = field(default_factory=dict)
    constants: Mapping[str, int] = field(default_factory=dict)
    when: str = "1"


@dataclass(frozen=True)
class Sequence:
    """A list of passes.

    Attributes:
        cleared: buffers to fill with zeros before the first pass.
        passes: in order.
    """

    cleared: tuple[str, ...]
    passes: tuple[Pass, ...]


def shader_names(sequences: Iterable[Sequence]) -> list[str]:
    """Names of the shaders that some sequences run, each once, in the order of their first use."""
    return list(dict.fromkeys(one.shader for sequence in sequences for one in sequence.passes))


@dataclass(frozen=True)
class Description:
    """Everything that a WebGPU host needs to run some sequences of passes.

    Attributes:
        definitions: numbers derived from the given ones, as expressions; later ones may use earlier ones.
        buffers: sizes in bytes, as expressions.
        uniforms: the layouts of the uniform buffers.
        shaders: by name.
        sequences: by name.
    """

    definitions: Mapping[str, str]
    buffers: Mapping[str, str]
    uniforms: Mapping[str, UniformLayout]
    shaders: Mapping[str, Shader]
    sequences: Mapping[str, Sequence]

    def part(self, sequences: Iterable[str], never: Iterable[str] = ()) -> Description:
        """The part needed by a host that runs only some of the sequences, without some of their passes.

        Args:
            sequences: names of those that it runs.
            never: names of passes that it leaves out.
        """
        kept = {
            name: replace(one, passes=tuple(each for each in one.passes if each.name not in never))
            for name, one in ((name, self.sequences[name]) for name in sequences)
        }
        run = set(shader_names(kept.values()))
        shaders = {name: shader for name, shader in self.shaders.items() if name in run}
        smaller = replace(self, sequences=kept, shaders=shaders)
        buffers = set(smaller.buffers_of(kept))
        used = {binding.name for shader in shaders.values() for binding in shader.bindings}
        return replace(
            smaller,
            buffers={name: size for name, size in self.buffers.items() if name in buffers},
            uniforms={name: layout for name, layout in self.uniforms.items() if name in used},
        )

    def symbols(self, given: Symbols) -> dict[str, int]:
        """The given numbers and all that are derived from them."""
        symbols = dict(given)
        for name, expression in self.definitions.items():
            symbols[name] = evaluate(expression, symbols)
        return symbols

    def buffers_of(self, sequences: Iterable[str]) -> list[str]:
        """Names of the buffers that some sequences use, without uniform buffers."""
        named: dict[str, None] = {}
        for sequence in (self.sequences[name] for name in sequences):
            named |= dict.fromkeys(sequence.cleared)
            for one in sequence.passes:
                bindings = self.shaders[one.shader].bindings
                named |= dict.fromkeys(one.buffers.get(binding.name, binding.name) for binding in bindings)
                named |= dict.fromkeys([one.indirect[0]] if one.indirect else [])
        return [name for name in named if name not in self.uniforms]

    def sizes(self, symbols: Symbols, buffers: Iterable[str]) -> dict[str, int]:
        """Sizes of buffers in bytes, never 0, which WebGPU does not allow."""
        return {name: max(evaluate(self.buffers[name], symbols), MIN_BUFFER) for name in buffers}

    def to_json(self) -> dict[str, Any]:
        """As plain lists and dictionaries, for `json.dumps`; `executor.js` loads the file."""
        return {
            "version": VERSION,
            "definitions": dict(self.definitions),
            "buffers": dict(self.buffers),
            "uniforms": {name: layout.to_json() for name, layout in self.uniforms.items()},
            "shaders": {
                file: {
                    "source": "".join(f"enable {name};\n" for name in shader.extensions) + shader.source,
                    "bindings": [{"name": binding.name, "access": binding.access} for binding in shader.bindings],
                }
                for file, shader in self.shaders.items()
            },
            "sequences": {
                name: {"cleared": list(sequence.cleared), "passes": [_pass_to_json(one) for one in sequence.passes]}
                for name, sequence in self.sequences.items()
            },
        }


def _pass_to_json(one: Pass) -> dict[str, Any]:
    return {
        "name": one.name,
        "shader": one.shader,
        "groups": one.groups,
        "indirect": list(one.indirect) if one.indirect else None,
        "buffers": dict(one.buffers),
        "constants": dict(one.constants),
        "when": one.when,
    }
