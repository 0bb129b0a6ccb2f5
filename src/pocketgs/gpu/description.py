"""Passes as data: what a host needs to run them, and nothing that depends on this one."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from pocketgs.gpu.shader_library import Shader
from pocketgs.gpu.sizes import Symbols, evaluate
from pocketgs.gpu.uniforms import UniformLayout

VERSION = 2

LEAST_BUFFER = 16
"""Bytes of a buffer that nothing is kept in: WebGPU allows no empty ones."""


@dataclass(frozen=True)
class Pass:
    """One dispatch of a shader.

    Attributes:
        name: for people; several passes may run one shader.
        shader: which.
        groups: number of workgroups, an expression; a host folds it into rows of at most 65,535. None where the GPU
            counts them: then `indirect` says where.
        indirect: a buffer and the offset in bytes at which it holds the three sizes of the dispatch.
        buffers: from the shader's names to the buffers they stand for, where those are not the same.
        constants: values of the shader's overrides.
        when: an expression; at 0 the pass is left out.
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
    """Passes in their order.

    Attributes:
        cleared: buffers filled with zeros before the first pass.
        passes: the passes.
    """

    cleared: tuple[str, ...]
    passes: tuple[Pass, ...]


@dataclass(frozen=True)
class Description:
    """Everything that a host with WebGPU needs to run some sequences of passes.

    Attributes:
        variants: which implementation each of the shaders' interfaces has.
        definitions: numbers that follow from the given ones, as expressions; later ones may use earlier ones.
        buffers: sizes in bytes, as expressions.
        uniforms: the layouts of the uniform buffers.
        shaders: by name.
        sequences: by name.
    """

    variants: Mapping[str, str]
    definitions: Mapping[str, str]
    buffers: Mapping[str, str]
    uniforms: Mapping[str, UniformLayout]
    shaders: Mapping[str, Shader]
    sequences: Mapping[str, Sequence]

    def symbols(self, given: Symbols) -> dict[str, int]:
        """The given numbers and all that follow from them."""
        symbols = dict(given)
        for name, expression in self.definitions.items():
            symbols[name] = evaluate(expression, symbols)
        return symbols

    def buffers_of(self, sequences: Iterable[str]) -> list[str]:
        """Names of the buffers that some of the sequences need, the uniform ones aside."""
        named: dict[str, None] = {}
        for sequence in (self.sequences[name] for name in sequences):
            named |= dict.fromkeys(sequence.cleared)
            for one in sequence.passes:
                bindings = self.shaders[one.shader].bindings
                named |= dict.fromkeys(one.buffers.get(binding.name, binding.name) for binding in bindings)
                named |= dict.fromkeys([one.indirect[0]] if one.indirect else [])
        return [name for name in named if name not in self.uniforms]

    def sizes(self, symbols: Symbols, buffers: Iterable[str]) -> dict[str, int]:
        """Bytes of buffers, never 0, which WebGPU does not allow."""
        return {name: max(evaluate(self.buffers[name], symbols), LEAST_BUFFER) for name in buffers}

    def to_json(self) -> dict[str, Any]:
        """As plain lists and dictionaries: `json.dumps` makes a file of it that `executor.js` can load."""
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
