"""The shaders of rendering and training, with the numbers of the image formation."""

from __future__ import annotations

import math
from pathlib import Path

from pocketgs.gpu.shader_library import ShaderLibrary
from pocketgs.splat import constants
from pocketgs.splat.colours import COLUMNS, UPDATES
from pocketgs.splat.limits import GSPLAT
from pocketgs.splat.reference.loss import ssim_window
from pocketgs.splat.webgpu.layout import MARGIN, PATCH, PLACES, TILE, WORDS

_IMAGE_FORMATION = (
    "LOW_PASS",
    "MIN_DETERMINANT",
    "MAX_VARIANCE",
    "BRIGHTEST",
    "ALPHA_MIN",
    "ALPHA_MAX",
    "TRANSMITTANCE_MIN",
    "SSIM_C1",
    "SSIM_C2",
    "NOISE_STEEPNESS",
    "NOISE_THRESHOLD",
    "RADIUS_SIGMAS",
)
MAX_LOG_SCALE = 40.0
"""In float32 the square of a larger one's exponential overflows. The other engines, in float64, leave that to
MAX_VARIANCE, under which nothing so large can be drawn."""

SHADERS = ShaderLibrary(
    Path(__file__).parent / "shaders",
    {
        **{name: getattr(constants, name) for name in _IMAGE_FORMATION},
        "LOG2_ALPHA_MIN": math.log2(constants.ALPHA_MIN),
        "GSPLAT_ALPHA_MAX": float(GSPLAT.most_opaque),
        "LOG2_E": math.log2(math.e),
        "MAX_LOG_SCALE": MAX_LOG_SCALE,
        "ARCTANGENT": constants.ARCTANGENT,
        "ARCTANGENT_TERMS": len(constants.ARCTANGENT),
        **PLACES,
        **WORDS,
        "COLOUR_COLUMNS": COLUMNS,
        "COLOUR_UPDATES": UPDATES,
        "TILE": TILE,
        "PATCH": PATCH,
        "MARGIN": MARGIN,
        "SSIM_WEIGHTS": [float(weight) for weight in ssim_window()],
    },
)
"""Link them with `SHADERS.link`."""
