"""The shaders of features, with the numbers that they share with the host."""

from __future__ import annotations

from pathlib import Path

from pocketgs.gpu.shader_library import ShaderLibrary
from pocketgs.prior.features.features import CONTRAST
from pocketgs.prior.features.webgpu.layout import CONSTANTS

SHADERS = ShaderLibrary(Path(__file__).parent / "shaders", {**CONSTANTS, "CONTRAST": CONTRAST})
"""Link them with `SHADERS.link`."""
