"""The shaders of merging, with the numbers that they share with the host."""

from __future__ import annotations

from pathlib import Path

from pocketgs.gpu.shader_library import ShaderLibrary
from pocketgs.prior.cloud.webgpu.layout import ATTRIBUTES, MERGED_WORDS

SHADERS = ShaderLibrary(Path(__file__).parent / "shaders", {"ATTRIBUTES": ATTRIBUTES, "MERGED_WORDS": MERGED_WORDS})
"""Link them with `SHADERS.link`."""
