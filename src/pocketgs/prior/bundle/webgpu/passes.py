"""The passes that make and reduce the normal equations, and those of the points' steps."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from pocketgs.gpu.description import Description, Pass, Sequence, shader_names
from pocketgs.gpu.shader_library import ShaderLibrary
from pocketgs.gpu.uniforms import UniformLayout
from pocketgs.gpu.workgroups import THREADS
from pocketgs.prior.bundle.cpu.equations import MIN_DIAGONAL
from pocketgs.prior.bundle.reprojection import CAMERA_UNKNOWNS, GRAZING
from pocketgs.prior.bundle.webgpu import layout
from pocketgs.prior.bundle.webgpu.layout import (
    CAMERA_SUMS,
    CAMERA_WORDS,
    COUPLING_WORDS,
    PAIR_SUMS,
    POINT_WORDS,
    SIGHT_WORDS,
)

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
"""The shaders of bundle adjustment, with the numbers that they share with the host."""

REDUCE, STEP = "reduce", "step"
"""Names of the sequences."""


@cache
def describe_equations() -> Description:
    """Describe bundle adjustment.

    The numbers that the expressions are computed from: cameras, points, observations, pairs (of cameras that see a
    point in common, each with itself too) and meetings (of two observations of a point).
    """
    by_point = f"ceil_div(points, {THREADS})"
    sequences = {
        REDUCE: Sequence(
            (),
            (
                Pass("linearise", "linearise", by_point),
                Pass("sum cameras", "sum_cameras", f"ceil_div({CAMERA_SUMS} * cameras, {THREADS})"),
                Pass("sum pairs", "sum_pairs", f"ceil_div({PAIR_SUMS} * pairs, {THREADS})"),
            ),
        ),
        STEP: Sequence((), (Pass("step points", "step_points", by_point),)),
    }
    buffers = {
        "cameras": f"{4 * CAMERA_WORDS} * cameras",
        "positions": "12 * points",
        "starts": "4 * (points + 1)",
        "frames": "4 * observations",
        "pixels": "8 * observations",
        "camera_starts": "4 * (cameras + 1)",
        "seen": "8 * observations",
        "pair_starts": "4 * (pairs + 1)",
        "meetings": "8 * meetings",
        "point_blocks": f"{4 * POINT_WORDS} * points",
        "sights": f"{4 * SIGHT_WORDS} * observations",
        "eliminated": f"{4 * COUPLING_WORDS} * observations",
        "camera_sums": f"{4 * CAMERA_SUMS} * cameras",
        "pair_sums": f"{4 * PAIR_SUMS} * pairs",
        "camera_step": f"{4 * CAMERA_UNKNOWNS} * cameras",
        "point_steps": "16 * points",
    }
    shaders = {name: SHADERS.link(name, {}) for name in shader_names(sequences.values())}
    uniforms = {"adjustment": UniformLayout.of("Adjustment", shaders["step_points"].source)}
    return Description({}, buffers, uniforms, shaders, sequences)
