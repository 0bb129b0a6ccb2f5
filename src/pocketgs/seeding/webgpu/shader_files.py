"""The shaders of neighbourhoods, with the numbers that they share with the host."""

from __future__ import annotations

from pathlib import Path

from pocketgs.gpu.shader_library import ShaderLibrary
from pocketgs.seeding.neighbourhoods import SPACING_NEIGHBOURS
from pocketgs.seeding.webgpu.layout import LEAF, MOST_NEIGHBOURS

SHADERS = ShaderLibrary(
    Path(__file__).parent / "shaders",
    {"LEAF": LEAF, "MOST_NEIGHBOURS": MOST_NEIGHBOURS, "SPACING_NEIGHBOURS": SPACING_NEIGHBOURS},
)
"""Link them with `SHADERS.link`."""
