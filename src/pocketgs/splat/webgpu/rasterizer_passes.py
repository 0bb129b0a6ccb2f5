"""The passes of the rasterizer: those of a training step, with any number of channels in place of three colours."""

from __future__ import annotations

from functools import cache

from pocketgs.gpu.description import Description, Pass, Sequence
from pocketgs.gpu.uniforms import UniformLayout
from pocketgs.splat.webgpu.passes import (
    CLEARED,
    DEFINITIONS,
    SORTED,
    SORTING_BUFFERS,
    Variant,
    bin_passes,
    rendering_buffers,
)
from pocketgs.splat.webgpu.shader_files import SHADERS

GROUP = 3
"""Channels that are composited together, where a step has its three colours."""

SHAPE_WORDS = 8
"""Of a row of gradients, before those of the channels; see `common/channel_rows.wgsl`."""

CENTRE_WORDS = 4
"""Of a Gaussian's row in `channel_gradients`, before the channels: the centre's gradient, signed and absolute."""

_FORWARD_BUFFERS = {
    "image": "16 * pixels * channel_groups",
    "channels": f"{4 * GROUP} * channel_groups * capacity",
}
_BACKWARD_BUFFERS = {
    "d_image": "16 * pixels * channel_groups",
    "gradient_rows": f"(4 * {SHAPE_WORDS} + {4 * GROUP} * channel_groups) * intersections",
    "gradients": "4 * columns * capacity",
    "channel_gradients": f"(4 * {CENTRE_WORDS} + {4 * GROUP} * channel_groups) * capacity",
}
_INSPECTION_BUFFERS = {
    "contribution_rows": "16 * intersections",
    "contributions": "16 * capacity",
    "median_depths": "4 * pixels",
}


def _backward(absolute: bool) -> Sequence:
    constants = {"absolute": int(absolute)}
    return Sequence(
        ("gradient_rows", "gradients", "channel_gradients"),
        (
            Pass("rasterize backward", "rasterize_channels_backward", "tiles", buffers=SORTED, constants=constants),
            Pass("project backward", "project_backward", "groups"),
            Pass("gather channels", "gather_channels", "groups"),
        ),
    )


_INSPECT = Sequence(
    ("contribution_rows", "contributions"),
    (
        Pass("inspect", "inspect", "tiles", buffers=SORTED),
        Pass("gather contributions", "gather_contributions", "groups"),
    ),
)


@cache
def describe_rasterizer(subgroups: bool, compositor: str = "over") -> Description:
    """Describe the rasterizer's passes.

    The numbers that the expressions are computed from: those of `describe` that rendering needs; channel_groups; and
    colours, 1 where the first group is the Gaussians' colour. Passes after "forward" work from what it has left.

    Args:
        subgroups: see `Variant`.
        compositor: "over", or "sum", which sorts nothing by depth and has nothing to inspect.
    """
    sections = {
        **Variant(subgroups=subgroups).sections,
        **{f"compositor.{part}": f"{compositor}.{part}" for part in ("forward", "backward", "inspection")},
        "replay.record": "replay.record_nothing",
        "channels.kind": "channels.groups",
        "gradient_rows.gather": "channel_rows.gather",
    }
    by_depth = compositor == "over"
    sequences = {
        "forward": Sequence(
            CLEARED if by_depth else tuple(name for name in CLEARED if name not in SORTING_BUFFERS),
            (
                *bin_passes(by_depth),
                Pass("take colours", "take_colours", "groups", when="colours"),
                Pass("rasterize", "rasterize", "tiles * channel_groups", buffers=SORTED),
            ),
        ),
        "backward": _backward(absolute=False),
        "backward, absolute too": _backward(absolute=True),
    }
    if by_depth:
        sequences["inspect"] = _INSPECT
    buffers = {**rendering_buffers(Variant()), **_FORWARD_BUFFERS, **_BACKWARD_BUFFERS, **_INSPECTION_BUFFERS}
    if not by_depth:
        for name in (*SORTING_BUFFERS, *_INSPECTION_BUFFERS):
            del buffers[name]
    names = dict.fromkeys(one.shader for sequence in sequences.values() for one in sequence.passes)
    shaders = {name: SHADERS.link(name, sections) for name in names}
    uniforms = {"view": UniformLayout.of("View", shaders["project"].source)}
    return Description(sections, DEFINITIONS, buffers, uniforms, shaders, sequences)
