"""The passes that composite splats which are already projected, as gsplat does, and go back to them."""

from __future__ import annotations

from functools import cache

from pocketgs.gpu.description import Description, Pass, Sequence, shader_names
from pocketgs.gpu.uniforms import UniformLayout
from pocketgs.splat.webgpu.buffers import DEFINITIONS, rendering_buffers
from pocketgs.splat.webgpu.passes import CLEARED, list_passes
from pocketgs.splat.webgpu.rasterizer_passes import (
    BACKWARD_BUFFERS,
    FORWARD_BUFFERS,
    RASTERIZE,
    backward_sequences,
    channel_sections,
)
from pocketgs.splat.webgpu.shader_files import SHADERS
from pocketgs.splat.webgpu.variant import Variant

SHAPE_GRADIENT_WORDS = 4
"""Of a splat's row in `shape_gradients`: see `gather_shapes.wgsl`."""


@cache
def describe_compositor(subgroups: bool) -> Description:
    """Describe the passes.

    They take `splats`, their `depth_keys` and `channels`, and in `gaussian_count` how many there are. The numbers that
    the expressions are computed from are those of `describe_rasterizer`; coefficients are 0.

    Args:
        subgroups: see `Variant`.
    """
    sections = channel_sections(subgroups, "over_gsplat")
    sequences = {
        "forward": Sequence(CLEARED, (Pass("count tiles", "count_tiles", "groups"), *list_passes(), RASTERIZE)),
        **backward_sequences("shape_gradients", Pass("gather shapes", "gather_shapes", "groups")),
    }
    buffers = {**rendering_buffers(Variant()), **FORWARD_BUFFERS, **BACKWARD_BUFFERS}
    buffers["shape_gradients"] = f"{4 * SHAPE_GRADIENT_WORDS} * capacity"
    shaders = {name: SHADERS.link(name, sections) for name in shader_names(sequences.values())}
    uniforms = {"view": UniformLayout.of("View", shaders["count_tiles"].source)}
    return Description(DEFINITIONS, buffers, uniforms, shaders, sequences).part(sequences)
