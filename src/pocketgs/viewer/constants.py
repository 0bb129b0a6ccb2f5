"""Numbers of Python that the page's modules import, as a module of JavaScript."""

from __future__ import annotations

import json

from pocketgs.files.memory_bound import DEFAULT_MB
from pocketgs.scene.gaussians import SH_DC
from pocketgs.splat import near_plane
from pocketgs.splat.constants import ALPHA_MAX, ALPHA_MIN, FRUSTUM_MARGIN, LOW_PASS, NEAR
from pocketgs.splat.webgpu.layout import FIRST_COLUMNS, SHAPE_COLUMNS, TILE
from pocketgs.splat.webgpu.memory import GROWTH, INTERSECTIONS_PER_GAUSSIAN, MIN_INTERSECTIONS
from pocketgs.splat.webgpu.shader_files import MAX_LOG_SCALE
from pocketgs.system.device import MB

MODULE = "constants.js"
"""Its path on the page."""

_CONSTANTS = {
    "ALPHA_MAX": ALPHA_MAX,
    "ALPHA_MIN": ALPHA_MIN,
    "FRUSTUM_MARGIN": FRUSTUM_MARGIN,
    "GROWTH": GROWTH,
    "INTERSECTIONS_PER_GAUSSIAN": INTERSECTIONS_PER_GAUSSIAN,
    "LOG_SCALE": FIRST_COLUMNS["log_scales"],
    "LOW_PASS": LOW_PASS,
    "MAX_BYTES": DEFAULT_MB * MB,
    "MAX_LOG_SCALE": MAX_LOG_SCALE,
    "MEAN": FIRST_COLUMNS["means"],
    "MIN_INTERSECTIONS": MIN_INTERSECTIONS,
    "NEAR": NEAR,
    "NEAR_SAMPLES": near_plane.SAMPLES,
    "OPACITY_LOGIT": FIRST_COLUMNS["opacity_logits"],
    "QUATERNION": FIRST_COLUMNS["quaternions"],
    "SHAPE_COLUMNS": SHAPE_COLUMNS,
    "SH_DC": SH_DC,
    "TILE": TILE,
}
"""Where each is explained, Python says: the modules that they are imported from here."""


def constants_module() -> str:
    """The source of the module."""
    return "".join(f"export const {name} = {json.dumps(value)};\n" for name, value in _CONSTANTS.items())
