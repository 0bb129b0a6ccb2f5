"""Lenses in the passes: each pass that projects has a shader for every camera model, and an image runs that of its own.

A shader has the formulas of one model, so that the others cost nothing where they are not used.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace

from numpy.typing import ArrayLike

from pocketgs.geometry.camera import Camera
from pocketgs.geometry.lens import largest_angle
from pocketgs.gpu.description import Pass
from pocketgs.gpu.shader_library import Shader
from pocketgs.splat.lens_bounds import least_radius_per_radian, stretch
from pocketgs.splat.slope_limits import slope_limits
from pocketgs.splat.webgpu.shader_files import SHADERS

PINHOLE = ("pinhole",)
LENSES = (*PINHOLE, "perspective", "fisheye", "orthographic")
"""The camera models; "perspective" is OpenCV's lens. Files `common/lens_….wgsl` have their formulas."""

_PROJECTING = ("cull", "project", "project_backward")
_OF_ANOTHER_LENS = {f"{shader}_{lens}": (shader, lens) for shader in _PROJECTING for lens in LENSES[1:]}
_FRUSTA = {"perspective": "bent", "fisheye": "bent"}


def through_lenses(passes: Iterable[Pass], lenses: tuple[str, ...]) -> list[Pass]:
    """The passes, with those that project once per lens. An image runs those of its symbol, see `lens_symbols`.

    Args:
        passes: for a pinhole camera.
        lenses: PINHOLE, which changes nothing, or LENSES.
    """
    if lenses == PINHOLE:
        return list(passes)
    return [
        each
        for one in passes
        for each in ([_through(one, lens) for lens in lenses] if one.shader in _PROJECTING else [one])
    ]


def _through(one: Pass, lens: str) -> Pass:
    shader = one.shader if lens == "pinhole" else f"{one.shader}_{lens}"
    return replace(one, shader=shader, when=f"({one.when}) * {lens}")


def link(name: str, sections: Mapping[str, str]) -> Shader:
    """Link a shader of `through_lenses`, or any other.

    Args:
        name: of its file, or that of a pass that projects and of a lens.
        sections: as for `SHADERS.link`.
    """
    shader, lens = _OF_ANOTHER_LENS.get(name, (name, "pinhole"))
    formulas = {
        "lens.kind": f"lens_{lens}",
        "lens.backward": f"lens_{lens}.backward",
        "frustum.kind": f"frustum.{_FRUSTA.get(lens, lens)}",
    }
    return replace(SHADERS.link(shader, {**sections, **formulas}), name=name)


def lens_of(camera: Camera) -> str:
    """The camera's lens, one of LENSES."""
    if camera.is_pinhole:
        return "pinhole"
    return "perspective" if camera.lens.model == "opencv" else camera.lens.model


def lens_symbols(camera: Camera) -> dict[str, int]:
    """Which lens a camera has, for `Description.symbols`: 1 for its lens and 0 for the others."""
    own = lens_of(camera)
    return {lens: int(lens == own) for lens in LENSES}


def lens_values(camera: Camera) -> dict[str, ArrayLike]:
    """Fields of the struct `Lens`; all 0 where the shaders need none."""
    own, lens = lens_of(camera), camera.lens
    if own in ("pinhole", "orthographic"):
        return _fields([0.0] * 12, 0.0, 0.0, 0.0, 0.0)
    limit = largest_angle(lens)
    bound = math.cos(limit) if own == "fisheye" else math.tan(limit) ** 2
    low, high = (tuple(map(float, slopes)) for slopes in slope_limits(camera))
    return _fields(lens.padded, limit, bound, least_radius_per_radian(lens), stretch(lens, low, high))


def _fields(
    coefficients: Iterable[float], largest: float, bound: float, least_radius: float, largest_stretch: float
) -> dict[str, ArrayLike]:
    first = list(coefficients)
    return {
        "first": first[:4],
        "second": first[4:8],
        "third": first[8:],
        "largest_angle": largest,
        "bound": bound,
        "least_radius": least_radius,
        "stretch": largest_stretch,
    }
