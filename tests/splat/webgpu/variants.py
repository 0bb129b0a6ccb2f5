"""The variants of the WebGPU engine that the tests go through, and how exact each is."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import pytest

from pocketgs.gpu.adapters import adapters
from pocketgs.splat.engine import EngineOptions
from pocketgs.splat.webgpu.engine import WebGpuEngine


@dataclass(frozen=True)
class Exactness:
    """Greatest differences from the reference that are rounding.

    Attributes:
        image: of a colour or of alpha.
        depth: relative.
        gradient: of the largest gradient of a group of parameters.
        loss: relative, after many steps.
    """

    image: float
    depth: float
    gradient: float
    loss: float


EXACT = {"f32": Exactness(1e-4, 1e-4, 2e-4, 1e-3), "f16": Exactness(1e-2, 1e-2, 1e-2, 2e-2)}

ORDERED = [
    EngineOptions("webgpu"),
    EngineOptions("webgpu", portable=True),
    EngineOptions("webgpu", replay="cache"),
    EngineOptions("webgpu", precision="f16"),
    EngineOptions("webgpu", precision="f16", replay="cache"),
]
"""They give the same bits every time."""

VARIANTS = [*ORDERED, EngineOptions("webgpu", accumulation="atomic")]


def _identify(options: EngineOptions) -> str:
    portable = ["portable"] if options.portable else []
    return "-".join([options.precision, options.replay, options.accumulation, *portable])


every_variant = pytest.mark.parametrize("options", VARIANTS, ids=_identify)
every_ordered_variant = pytest.mark.parametrize("options", ORDERED, ids=_identify)


@cache
def shared_engine(options: EngineOptions) -> WebGpuEngine:
    """An engine whose pipelines are compiled once for all tests: `set_views` and `upload` start it anew."""
    if options.accumulation == "atomic" and "shader-float32-atomic" not in adapters()[0].features:
        pytest.skip(f"{adapters()[0].name} cannot add floats atomically")
    return WebGpuEngine(options)
