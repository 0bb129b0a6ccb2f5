"""The shaders of the sweep, with the numbers that they share with the CPU's kernels."""

from __future__ import annotations

from pathlib import Path

from pocketgs.gpu.shader_library import ShaderLibrary
from pocketgs.prior.depth import sweep_constants
from pocketgs.prior.depth.webgpu import layout

_SHARED = (
    "RADIUS",
    "BITS",
    "EDGE",
    "NOISE",
    "RIVAL_DISTANCE",
    "OUT_OF_REACH",
    "SMOOTHING_WINDOW",
    "SMOOTHING_WIDTH",
    "SMOOTHING_STEPS",
)

SHADERS = ShaderLibrary(
    Path(__file__).parent / "shaders",
    {
        **{name: getattr(sweep_constants, name) for name in _SHARED},
        **{name: getattr(layout, name) for name in ("PATCH", "CHUNK", "LANE", "PATH_THREADS", "MATCHED", "USABLE")},
    },
)
"""Link them with `SHADERS.link`."""
