"""The passes of a plane sweep, and of the comparison of depth maps."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from pathlib import Path

from pocketgs.gpu.description import Description, Pass, Sequence
from pocketgs.gpu.shader_library import ShaderLibrary
from pocketgs.gpu.uniforms import UniformLayout
from pocketgs.gpu.workgroups import THREADS
from pocketgs.prior.depth import confidence, consistency, sweep_constants
from pocketgs.prior.depth.webgpu import layout
from pocketgs.prior.depth.webgpu.layout import CHUNK, LANE, MOST_BANDS, PATCH, PATH_THREADS

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

_COHERENCE = ("AROUND", "COHERENT_STEPS", "CONFIRMED")

_CONFIDENCE = ("CLEAR_MARGIN", "HOLE", "HOLE_SHARE", "FILLER_MARGIN", "FILLER_CONFIDENCE")

SHADERS = ShaderLibrary(
    Path(__file__).parent / "shaders",
    {
        **{name: getattr(sweep_constants, name) for name in _SHARED},
        **{name: getattr(consistency, name) for name in _COHERENCE},
        **{name: getattr(confidence, name) for name in _CONFIDENCE},
        **{name: getattr(layout, name) for name in ("PATCH", "CHUNK", "LANE", "PATH_THREADS", "MATCHED", "USABLE")},
    },
)
"""The shaders of sweep and comparison, with the numbers that they share with the CPU."""

SWEEP, COMPARE = "sweep", "compare"
"""Names of the sequences."""

DEFINITIONS = {
    "image_pixels": "image_width * image_height",
    "pixels": "width * height",
    "band_rows": "ceil_div(height, bands)",
    "band_pixels": "width * band_rows",
    "patches": f"ceil_div(width, {PATCH}) * ceil_div(band_rows, {PATCH})",
    "chunks": f"ceil_div(hypotheses, {CHUNK})",
    "lanes": f"ceil_div(hypotheses, {LANE})",
    # Rounded down.
    "lines_at_once": f"0 - ceil_div(0 - {PATH_THREADS}, lanes)",
}

_WAYS = {
    "right": (0, 1),
    "left": (0, -1),
    "down": (1, 0),
    "up": (-1, 0),
    "down and right": (1, 1),
    "up and left": (-1, -1),
    "down and left": (1, -1),
    "up and right": (-1, 1),
}
"""(row, column) steps of the paths, in the order of `pocketgs.prior.depth.cpu.semi_global`."""

_BANDS = range(MOST_BANDS)

RECORD_BYTES = 80
"""Of a view in the comparison of depth maps: see `agreement.wgsl`."""


def _buffers() -> dict[str, str]:
    """Sizes in bytes. Only the first of the buffers of bands are used where one band is enough."""
    sizes = {
        "photographs": "4 * image_pixels * images",
        "squares": "4 * image_pixels * (images - 1)",
        "sources": "64 * (images - 1)",
        "inverse_depths": "4 * hypotheses",
        "winner_depths": "4 * pixels",
        "margins": "4 * pixels",
        "depths": "4 * pixels",
    }
    for band in _BANDS:
        sizes[f"costs_{band}"] = f"{LANE} * lanes * band_pixels * (bands > {band})"
        sizes[f"totals_{band}"] = f"{2 * LANE} * lanes * band_pixels * (bands > {band})"
    for parity in range(2):
        sizes[f"carried_{parity}"] = f"{4 * LANE} * lanes * width * (bands > 1)"
    return sizes


def _by_band(name: str, shader: str, groups: str, volume: str) -> Iterator[Pass]:
    """A pass that works on one band of a volume, for each of them."""
    for band in _BANDS:
        buffers, constants = {volume: f"{volume}_{band}"}, {"band": band}
        yield Pass(name, shader, groups, buffers=buffers, constants=constants, when=f"bands > {band}")


def _aggregate(way: str) -> Iterator[Pass]:
    """Paths of one direction, through the bands in the order in which they come to them."""
    down, across = _WAYS[way]
    number = list(_WAYS).index(way)
    length = "band_rows" if down == 0 else "width"
    for band in _BANDS if down >= 0 else reversed(_BANDS):
        yield Pass(
            f"aggregate {way}",
            "aggregate",
            f"ceil_div({length}, lines_at_once)",
            buffers={
                "costs": f"costs_{band}",
                "totals": f"totals_{band}",
                "carried_in": f"carried_{(band + 1) % 2}",
                "carried_out": f"carried_{band % 2}",
            },
            constants={"down": down, "across": across, "is_first": int(number == 0), "band": band},
            when=f"(bands > {band}) * (paths > {number})",
        )


@cache
def describe_sweep() -> Description:
    """Describe a sweep.

    The numbers that the expressions are computed from: width and height of the view; image_width and image_height, what
    all images are padded to; images, their number, the view among them; hypotheses; paths, 4 or 8; and bands, how many
    bands of rows the volume is divided into, at most MOST_BANDS.
    """
    passes = [
        Pass("squares", "squares", f"ceil_div(image_pixels * (images - 1), {THREADS})"),
        *_by_band("matching costs", "matching_costs", "patches * chunks", "costs"),
        *(one for way in _WAYS for one in _aggregate(way)),
        *_by_band("winners", "winners", f"ceil_div(band_pixels, {THREADS})", "totals"),
        Pass("smooth", "smooth", f"ceil_div(pixels, {THREADS})"),
    ]
    shaders = {name: SHADERS.link(name, {}) for name in dict.fromkeys(one.shader for one in passes)}
    uniforms = {"sweep": UniformLayout.of("Sweep", shaders["squares"].source)}
    return Description(DEFINITIONS, _buffers(), uniforms, shaders, {SWEEP: Sequence((), tuple(passes))})


@cache
def describe_comparison() -> Description:
    """Describe the comparison of one view's depths with the other views', and the confidence that follows from it.

    The numbers that the expressions are computed from: width and height of the view; image_width and image_height, what
    all depth maps are padded to; and views, their number.
    """
    definitions = {"image_pixels": "image_width * image_height", "pixels": "width * height"}
    buffers = {
        "maps": "4 * image_pixels * views",
        "others": f"{RECORD_BYTES} * views",
        **{name: "4 * pixels" for name in ("votes", "footprints", "margins", "confidences", "counts")},
    }
    by_pixel = f"ceil_div(pixels, {THREADS})"
    passes = tuple(
        Pass(name.replace("_", " "), name, by_pixel)
        for name in ("agreement", "confidence", "count_believed", "fill_holes")
    )
    shaders = {one.shader: SHADERS.link(one.shader, {}) for one in passes}
    uniforms = {"comparison": UniformLayout.of("Comparison", shaders["agreement"].source)}
    return Description(definitions, buffers, uniforms, shaders, {COMPARE: Sequence((), passes)})
