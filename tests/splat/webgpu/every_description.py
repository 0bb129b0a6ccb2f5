"""Every description of passes that the package makes."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from itertools import product
from typing import get_args

from pocketgs.gpu.description import Description, Pass, Sequence
from pocketgs.gpu.shader_library import Shader
from pocketgs.prior.bundle.webgpu.passes import describe_equations
from pocketgs.prior.cloud.webgpu.passes import describe_merging
from pocketgs.prior.depth.webgpu.passes import describe_comparison, describe_sweep
from pocketgs.prior.features.webgpu.passes import describe_features, describe_matching
from pocketgs.seeding.webgpu.passes import describe_neighbourhoods
from pocketgs.splat.webgpu.compositor_passes import describe_compositor
from pocketgs.splat.webgpu.lenses import LENSES
from pocketgs.splat.webgpu.passes import describe_rendering, describe_training
from pocketgs.splat.webgpu.rasterizer_passes import describe_rasterizer
from pocketgs.splat.webgpu.variant import Variant, Weights

TRAINING = [
    Variant(precision, replay, accumulation, subgroups)  # type: ignore[arg-type]
    for precision, replay, accumulation, subgroups in product(
        ("f32", "f16"), ("recompute", "cache"), ("ordered", "atomic"), (False, True)
    )
]
RENDERING = [Variant(appearance="points"), Variant(appearance="discs")]
RENDERING += [Variant(weights=weights, lenses=LENSES) for weights in get_args(Weights)]
DESCRIPTIONS = {str(variant): describe_training(variant) for variant in TRAINING}
DESCRIPTIONS |= {"lenses": describe_training(Variant(lenses=LENSES))}
DESCRIPTIONS |= {str(variant): describe_rendering(variant) for variant in RENDERING}
DESCRIPTIONS |= {f"rasterizer {subgroups}": describe_rasterizer(subgroups) for subgroups in (False, True)}
DESCRIPTIONS |= {"rasterizer sum": describe_rasterizer(False, "sum"), "sweep": describe_sweep()}
DESCRIPTIONS |= {"comparison": describe_comparison()}
DESCRIPTIONS |= {"features": describe_features(), "matching": describe_matching()}
DESCRIPTIONS |= {"equations": describe_equations(), "merging": describe_merging()}
DESCRIPTIONS |= {"neighbourhoods": describe_neighbourhoods()}
DESCRIPTIONS |= {f"compositor {subgroups}": describe_compositor(subgroups) for subgroups in (False, True)}

OPTIONAL = {str(variant) for variant in TRAINING if variant.features} | {"rasterizer True", "compositor True"}
PORTABLE = {name: description for name, description in DESCRIPTIONS.items() if name not in OPTIONAL}
"""Descriptions that every device must run: without subgroups and atomic additions of floats."""


def every_shader(but: Collection[Description] = ()) -> Description:
    """A description with a pass for each of the portable shaders, of which nothing but the pipelines can be made.

    Args:
        but: descriptions whose shaders are left out.
    """
    known = {shader.source for description in but for shader in description.shaders.values()}
    shaders: dict[str, Shader] = {}
    passes: dict[str, Pass] = {}
    for description in PORTABLE.values():
        for one in (one for sequence in description.sequences.values() for one in sequence.passes):
            shader = description.shaders[one.shader]
            if shader.source not in known | passes.keys():
                name = f"{shader.name} {len(passes)}"
                shaders[name] = replace(shader, name=name)
                passes[shader.source] = replace(one, shader=name)
    return Description({}, {}, {}, shaders, {"all": Sequence((), tuple(passes.values()))})
