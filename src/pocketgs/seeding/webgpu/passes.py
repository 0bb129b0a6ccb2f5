"""The passes that find every point's nearest neighbours, and the surface through them."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from pocketgs.gpu.description import Description, Pass, Sequence, shader_names
from pocketgs.gpu.shader_library import ShaderLibrary
from pocketgs.gpu.uniforms import UniformLayout
from pocketgs.gpu.workgroups import THREADS
from pocketgs.seeding.neighbourhoods import SPACING_NEIGHBOURS
from pocketgs.seeding.webgpu.layout import BOX_BYTES, LARGEST_BYTES, LEAF, MOST_NEIGHBOURS

SHADERS = ShaderLibrary(
    Path(__file__).parent / "shaders",
    {"LEAF": LEAF, "MOST_NEIGHBOURS": MOST_NEIGHBOURS, "SPACING_NEIGHBOURS": SPACING_NEIGHBOURS},
)
"""The shaders of neighbourhoods, with the numbers that they share with the host."""

LOOK_AROUND = "look around"
"""Name of the sequence."""


@cache
def describe_neighbourhoods() -> Description:
    """Describe how neighbourhoods are found.

    The numbers that the expressions are computed from: points; and leaves, see `numbers_of`.
    """
    by_point = f"ceil_div(points, {THREADS})"
    passes = (
        Pass("enclose points", "enclose_points", f"ceil_div(leaves, {THREADS})"),
        Pass("enclose boxes", "enclose_boxes", "1"),
        Pass("nearest points", "nearest_points", by_point),
        Pass("surfaces", "surfaces", by_point),
    )
    buffers = {
        "positions": "12 * points",
        "boxes": f"{2 * BOX_BYTES} * leaves",
        "neighbours": f"{LARGEST_BYTES} * points",
        "spacing": "4 * points",
        "normals": "12 * points",
        "tangents": "12 * points",
    }
    sequences = {LOOK_AROUND: Sequence((), passes)}
    shaders = {name: SHADERS.link(name, {}) for name in shader_names(sequences.values())}
    uniforms = {"cloud": UniformLayout.of("Cloud", shaders["surfaces"].source)}
    return Description({}, buffers, uniforms, shaders, sequences)
