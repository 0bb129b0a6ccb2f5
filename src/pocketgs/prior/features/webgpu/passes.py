"""The passes that find features, describe them, and match two images' features."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from pathlib import Path

from pocketgs.gpu.description import Description, Pass, Sequence, shader_names
from pocketgs.gpu.shader_library import ShaderLibrary
from pocketgs.gpu.uniforms import UniformLayout
from pocketgs.gpu.workgroups import THREADS
from pocketgs.prior.features.features import CONTRAST, DESCRIPTOR
from pocketgs.prior.features.webgpu.layout import (
    BORDER,
    CONSTANTS,
    FEATURE,
    IMAGES,
    LAYERS,
    MOST_OCTAVES,
    NEAREST,
    TILE,
    kernels,
)

SHADERS = ShaderLibrary(Path(__file__).parent / "shaders", {**CONSTANTS, "CONTRAST": CONTRAST})
"""The shaders of features, with the numbers that they share with the host."""

FIND = tuple(f"find in octave {octave}" for octave in range(MOST_OCTAVES))
DESCRIBE = tuple(f"describe in octave {octave}" for octave in range(MOST_OCTAVES))
MATCH = "match"
"""Names of the sequences. Those of an octave come one after the other, each with its number in the uniform buffer: as a
constant of the shaders it would need pipelines for each."""

_OCTAVES = range(MOST_OCTAVES)


def _definitions() -> dict[str, str]:
    """The pixels of each octave; how many octaves have room between their borders; and room for more extrema than
    blurred images have.
    """
    halved = {
        f"{side}_{octave}": f"0 - ceil_div(0 - {side}_{octave - 1}, 2)"  # rounded down
        for octave in _OCTAVES[1:]
        for side in ("width", "height")
    }
    has_room = (f"(width_{octave} > {2 * BORDER}) * (height_{octave} > {2 * BORDER})" for octave in _OCTAVES[1:])
    return {
        "pixels": "width * height",
        "width_0": "2 * width",
        "height_0": "2 * height",
        **halved,
        **{f"pixels_{octave}": f"width_{octave} * height_{octave}" for octave in _OCTAVES},
        "octaves": " + ".join(["1", *has_room]),
        "keypoint_room": "ceil_div(pixels, 4)",
        "feature_room": "ceil_div(pixels, 2)",
    }


def _buffers() -> dict[str, str]:
    """Sizes in bytes."""
    return {
        "grey": "4 * pixels",
        "kernels": f"{4 * sum(map(len, kernels()))}",
        "across": "4 * pixels_0",
        **{f"octave_{octave}": f"{4 * IMAGES} * pixels_{octave} * (octaves > {octave})" for octave in _OCTAVES},
        "counts": "8",
        "keypoints": f"{FEATURE.itemsize} * keypoint_room",
        "features": f"{FEATURE.itemsize} * feature_room",
        "descriptors": f"{4 * DESCRIPTOR} * chosen",
    }


def _by_pixel(octave: int, layers: int = 1) -> str:
    return f"ceil_div({layers} * pixels_{octave}, {THREADS})"


def _blur(octave: int, kernel: int, sharp: int, blurred: int) -> Iterator[Pass]:
    """Along the rows, then along the columns."""
    images, groups = f"octave_{octave}", _by_pixel(octave)
    lengths = list(map(len, kernels()))
    taps = {"kernel": sum(lengths[:kernel]), "radius": lengths[kernel] - 1}
    across, down = {**taps, "sharp_layer": sharp}, {**taps, "blurred_layer": blurred, "is_down": 1}
    yield Pass("blur across", "blur", groups, buffers={"sharp": images, "blurred": "across"}, constants=across)
    yield Pass("blur down", "blur", groups, buffers={"sharp": "across", "blurred": images}, constants=down)


def _find(octave: int) -> Iterator[Pass]:
    """The images of an octave, and the extrema and features in them."""
    images = {"scale_space": f"octave_{octave}"}
    if octave == 0:
        yield Pass("enlarge", "enlarge", _by_pixel(0), buffers=images)
        yield from _blur(0, kernel=0, sharp=1, blurred=0)
    else:
        before = {"before": f"octave_{octave - 1}"}
        yield Pass("halve", "halve", _by_pixel(octave), buffers={**images, **before})
    for layer in range(1, IMAGES):
        yield from _blur(octave, kernel=layer, sharp=layer - 1, blurred=layer)
    yield Pass("extrema", "extrema", _by_pixel(octave, LAYERS), buffers=images)
    yield Pass("orient", "orient", f"ceil_div(keypoint_room, {THREADS})", buffers=images)


@cache
def describe_features() -> Description:
    """Describe how features are found and described.

    The numbers that the expressions are computed from: width and height of the photograph; and chosen, how many
    features are described.
    """
    sequences = {}
    for octave in _OCTAVES:
        sequences[FIND[octave]] = Sequence(("counts",) if octave == 0 else (), tuple(_find(octave)))
        describe = Pass("describe", "describe", "chosen", buffers={"scale_space": f"octave_{octave}"})
        sequences[DESCRIBE[octave]] = Sequence((), (describe,))
    shaders = {name: SHADERS.link(name, {}) for name in shader_names(sequences.values())}
    uniforms = {"image": UniformLayout.of("Image", shaders["enlarge"].source)}
    return Description(_definitions(), _buffers(), uniforms, shaders, sequences)


@cache
def describe_matching() -> Description:
    """Describe how two images' descriptors are matched.

    The numbers that the expressions are computed from: first and second, how many descriptors the images have.
    """
    buffers = {
        "first_descriptors": f"{4 * DESCRIPTOR} * first",
        "second_descriptors": f"{4 * DESCRIPTOR} * second",
        "forwards": f"{NEAREST.itemsize} * first",
        "backwards": f"{NEAREST.itemsize} * second",
    }
    first, second = "first_descriptors", "second_descriptors"
    forwards = {"rows": first, "columns": second, "nearest": "forwards"}
    backwards = {"rows": second, "columns": first, "nearest": "backwards"}
    passes = (
        Pass("nearest forwards", "nearest", f"ceil_div(first, {TILE})", buffers=forwards),
        Pass("nearest backwards", "nearest", f"ceil_div(second, {TILE})", None, backwards, {"is_swapped": 1}),
    )
    shader = SHADERS.link("nearest", {})
    uniforms = {"sizes": UniformLayout.of("Match", shader.source)}
    return Description({}, buffers, uniforms, {shader.name: shader}, {MATCH: Sequence((), passes)})
