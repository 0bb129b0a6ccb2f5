"""The passes of the rasterizer: those of a training step, with any number of channels in place of three colours."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

from pocketgs.gpu.description import Description, Pass, Sequence, shader_names
from pocketgs.splat.webgpu.buffers import DEFINITIONS, SORTING_BUFFERS, rendering_buffers
from pocketgs.splat.webgpu.layout import CENTRE_WORDS, SHAPE_WORDS
from pocketgs.splat.webgpu.lenses import LENSES, link, through_lenses
from pocketgs.splat.webgpu.passes import CLEARED, SORT_BY_DEPTH, SORTED, bin_passes, camera_uniforms
from pocketgs.splat.webgpu.variant import Variant

GROUP = 3
"""Channels that are composited together, where a step has its three colours."""

FORWARD_BUFFERS = {
    "image": "16 * pixels * channel_groups",
    "channels": f"{4 * GROUP} * channel_groups * capacity",
}
BACKWARD_BUFFERS = {
    "d_image": "16 * pixels * channel_groups",
    "gradient_rows": f"(4 * {SHAPE_WORDS} + {4 * GROUP} * channel_groups) * intersections",
    "channel_gradients": f"(4 * {CENTRE_WORDS} + {4 * GROUP} * channel_groups) * capacity",
}
_INSPECTION_BUFFERS = {
    "contribution_rows": "16 * intersections",
    "contributions": "16 * capacity",
    "median_depths": "4 * pixels",
}


RASTERIZE = Pass("rasterize", "rasterize", "tiles * channel_groups", buffers=SORTED)
_RASTERIZE_BACKWARD = Pass("rasterize backward", "rasterize_channels_backward", "tiles", buffers=SORTED)
_PROJECT_BACKWARD = Pass("project backward", "project_backward", "groups")
_GATHER_CHANNELS = Pass("gather channels", "gather_channels", "groups")


def backward_sequence(absolute: bool) -> str:
    """The name of the sequence from an image's gradient to those of what was drawn."""
    return "backward, absolute too" if absolute else "backward"


def backward_sequences(gathered: str, *gather: Pass) -> dict[str, Sequence]:
    """The sequences of `backward_sequence`.

    Args:
        gathered: buffer that `gather` writes to.
        gather: the passes after rasterizing backward, besides that of the channels.
    """
    return {
        backward_sequence(absolute): Sequence(
            ("gradient_rows", gathered, "channel_gradients"),
            (replace(_RASTERIZE_BACKWARD, constants={"absolute": int(absolute)}), *gather, _GATHER_CHANNELS),
        )
        for absolute in (False, True)
    }


_INSPECT = Sequence(
    ("contribution_rows", "contributions"),
    (
        Pass("inspect", "inspect", "tiles", buffers=SORTED),
        Pass("gather contributions", "gather_contributions", "groups"),
    ),
)


def _with_and_without_antialiasing(one: Pass) -> tuple[Pass, Pass]:
    """Two passes of which an image takes one."""
    antialiased = replace(one, name=f"{one.name}, antialiased", constants={"antialiased": 1}, when="antialiased")
    return antialiased, replace(one, when="1 - antialiased")


def channel_sections(subgroups: bool, compositor: str) -> dict[str, str]:
    """The sections of shaders that composite channels with the rule of this file."""
    return {
        **Variant(subgroups=subgroups).sections,
        **{f"compositor.{part}": f"{compositor}.{part}" for part in ("forward", "backward", "inspection")},
        "replay.record": "replay.record_nothing",
        "channels.kind": "channels.groups",
        "gradient_rows.gather": "channel_rows.gather",
    }


@cache
def describe_rasterizer(subgroups: bool, compositor: str = "over") -> Description:
    """Describe the rasterizer's passes.

    The numbers that the expressions are computed from: those of `describe_rendering`; channel_groups;
    colours, 1 where the first group is the Gaussians' colour; antialiased, 1 or 0; and those of `lens_symbols`. Passes
    after "forward" work from what it has left.

    Args:
        subgroups: see `Variant`.
        compositor: "over", or "sum", which sorts nothing by depth and has nothing to inspect.
    """
    sections = channel_sections(subgroups, compositor)
    by_depth = compositor == "over"
    # No bounds of clusters hold: each image may be of another scene.
    cleared = (*CLEARED, "cluster_bounds")
    binning = [
        part
        for one in bin_passes(SORT_BY_DEPTH if by_depth else ())
        for part in (_with_and_without_antialiasing(one) if one.shader == "project" else (one,))
    ]
    sequences = {
        "forward": Sequence(
            cleared if by_depth else tuple(name for name in cleared if name not in SORTING_BUFFERS),
            (
                *through_lenses(binning, LENSES),
                Pass("take colours", "take_colours", "groups", when="colours"),
                RASTERIZE,
            ),
        ),
        **backward_sequences("gradients", *through_lenses(_with_and_without_antialiasing(_PROJECT_BACKWARD), LENSES)),
    }
    if by_depth:
        sequences["inspect"] = _INSPECT
    buffers = {**rendering_buffers(Variant()), **FORWARD_BUFFERS, **BACKWARD_BUFFERS, **_INSPECTION_BUFFERS}
    buffers["gradients"] = "4 * columns * capacity"
    if not by_depth:
        for name in (*SORTING_BUFFERS, *_INSPECTION_BUFFERS):
            del buffers[name]
    shaders = {name: link(name, sections) for name in shader_names(sequences.values())}
    return Description(DEFINITIONS, buffers, camera_uniforms(shaders["project"]), shaders, sequences)
