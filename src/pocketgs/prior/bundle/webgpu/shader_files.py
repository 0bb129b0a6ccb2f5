"""The shaders of bundle adjustment, with the numbers that they share with the host."""

from __future__ import annotations

from pathlib import Path

from pocketgs.gpu.shader_library import ShaderLibrary
from pocketgs.prior.bundle.reprojection import CAMERA_UNKNOWNS, GRAZING
from pocketgs.prior.bundle.schur import MIN_DIAGONAL
from pocketgs.prior.bundle.webgpu import layout

_LEAST_PIVOT = 1e-6
"""Share of a diagonal entry that stays of its pivot: what single precision can tell from 0."""

_SIZES = ("CAMERA_WORDS", "POINT_WORDS", "COLUMNS", "COUPLING_WORDS", "SIGHT_WORDS", "CAMERA_SUMS", "PAIR_SUMS")

SHADERS = ShaderLibrary(
    Path(__file__).parent / "shaders",
    {
        "CAMERA_UNKNOWNS": CAMERA_UNKNOWNS,
        "RESIDUAL": CAMERA_UNKNOWNS,
        **{name: getattr(layout, name) for name in _SIZES},
        "GRAZING": GRAZING,
        "MIN_DIAGONAL": MIN_DIAGONAL,
        "LEAST_PIVOT": _LEAST_PIVOT,
    },
)
"""Link them with `SHADERS.link`."""
