"""The passes of rendering and of a training step, in their order."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

from pocketgs.gpu.description import Description, Pass, Sequence, shader_names
from pocketgs.gpu.shader_library import Shader
from pocketgs.gpu.sort import Items, radix_sort, running_sums
from pocketgs.gpu.uniforms import UniformLayout
from pocketgs.gpu.workgroups import DIGIT_BITS, THREADS
from pocketgs.splat.webgpu.buffers import DEFINITIONS, rendering_buffers, training_buffers
from pocketgs.splat.webgpu.lenses import link, through_lenses
from pocketgs.splat.webgpu.variant import Variant

_GAUSSIANS = Items("gaussian_count", blocks="blocks")
_INTERSECTIONS = Items("intersection_count", indirect=("intersection_dispatches", 0))


def _tiles_have_digit(shift: int) -> str:
    """Whether the tiles' numbers, and one more that stands for no tile, reach a digit or its neighbour in the pair."""
    return f"tiles + 1 > {1 << (shift - shift % (2 * DIGIT_BITS))}"


SORT_BY_DEPTH = tuple(radix_sort(_GAUSSIANS, "depth_keys", "order", "depth_digit", 32, lambda _: "1"))
"""Passes that sort projected splats, nearest first."""


def bin_passes(sort: tuple[Pass, ...] = SORT_BY_DEPTH) -> list[Pass]:
    """Everything before rasterizing: tiles' lists of splats, in the order of `sort`, or as they lie in memory."""
    return [
        Pass("bound clusters", "bound_clusters", "groups"),
        Pass("cull", "cull", "1"),
        Pass("project", "project", "groups"),
        *list_passes(sort),
    ]


def list_passes(sort: tuple[Pass, ...] = SORT_BY_DEPTH) -> list[Pass]:
    """Tiles' lists from projected splats, and the number of tiles that each reaches."""
    return [
        *sort,
        *running_sums(_GAUSSIANS, "tile_counts", "order", "block_sums", "first_slots"),
        Pass("plan", "plan", "1"),
        Pass("emit", "emit", "groups"),
        *radix_sort(_INTERSECTIONS, "tile_keys", "slots", "tile_digit", 24, _tiles_have_digit),
        Pass("tile ranges", "tile_ranges", indirect=("intersection_dispatches", 12)),
    ]


CLEARED = ("depth_digit", "tile_digit", "tile_starts")
"""Buffers that `bin_passes` need filled with zeros."""

SORTED = {"sorted_slots": "slots"}
_RASTERIZE = Pass("rasterize", "rasterize", "tiles", buffers=SORTED)
_RASTERIZE_DEPTH = Pass("rasterize", "rasterize", "tiles", buffers=SORTED, constants={"draw_depth": 1})
_REPLAY = Pass("rasterize backward", "rasterize_backward", "tiles", buffers=SORTED)


def _replayed(variant: Variant, replay: Pass) -> tuple[tuple[str, ...], tuple[Pass, ...]]:
    """Buffers to clear and passes to run for a replay into rows of gradients that start at 0."""
    if variant.accumulation == "atomic":
        return ("gradient_rows",), (replay,)
    return (), (Pass("clear rows", "clear_rows", indirect=("intersection_dispatches", 12)), replay)


def _step(variant: Variant) -> Sequence:
    cleared, replayed = _replayed(variant, _REPLAY)
    return Sequence(
        (*CLEARED, *cleared),
        (
            *bin_passes(),
            Pass("rasterize", "rasterize_for_replay", "tiles", buffers=SORTED),
            Pass("dssim", "dssim", "patches", when="structural"),
            Pass("loss", "loss", "patches"),
            *replayed,
            Pass("project backward", "project_backward", "groups"),
            Pass("collect statistics", "collect_statistics", "groups", when="collecting"),
            Pass("regularise", "regularise", "groups", when="regularised"),
            Pass("adam", "adam", "groups"),
            Pass("sum loss", "sum_loss", "1"),
        ),
    )


# After the errors, which are those before the update.
_LEARN_COLOURS = Sequence((), (Pass("learn colours", "learn_colours", "1"),))


def _errors(variant: Variant) -> Sequence:
    """Passes that, after a step, add each Gaussian's contribution to the view's error."""
    cleared, replayed = _replayed(variant, replace(_REPLAY, name="rasterize error backward"))
    return Sequence(
        cleared,
        (
            Pass("write error", "write_error", f"ceil_div(pixels, {THREADS})"),
            *replayed,
            Pass("collect errors", "collect_errors", "groups"),
        ),
    )


TABLES = ("shape", "sh", "first_moments", "second_moments")
"""Buffers that lie column by column, with a number for every Gaussian in each column."""

GATHERED = "gradients"
"""Buffer that table rows are gathered in, and then new values written to; free between steps."""

SOURCES = "row_sources"
"""Buffer for the rows that are gathered, and then for those that new values are for."""


def _row_sequences() -> dict[str, Sequence]:
    """Sequences that gather the rows of each table, and that set some of them."""
    sequences: dict[str, Sequence] = {}
    for table in TABLES:
        gathering = {"table": table, "gathered": GATHERED, "row_sources": SOURCES}
        setting = {"table": table, "listed_values": GATHERED, "listed_rows": SOURCES}
        gather = Pass(f"gather {table}", "gather_rows", "groups", buffers=gathering)
        set_rows = Pass(f"set {table}", "set_rows", f"ceil_div(listed, {THREADS})", buffers=setting)
        sequences |= {gather.name: Sequence((), (gather,)), set_rows.name: Sequence((), (set_rows,))}
    return sequences


@cache
def describe_rendering(variant: Variant) -> Description:
    """Describe rendering.

    The numbers that the expressions are computed from: gaussians, capacity (room for them), coefficients,
    view_coefficients (of weights, where there are any), width, height, and intersections (room for them); those of
    `lens_symbols`, where cameras may have a lens; and for a rasterization of some of the tiles, drawn_tiles, their
    number.
    """
    return _described(variant, rendering_buffers(variant), _rendering_sequences(variant))


@cache
def describe_training(variant: Variant) -> Description:
    """Describe rendering and training of sorted splats.

    The numbers that the expressions are computed from: those of `describe_rendering`, photographs, photograph_pixels,
    replay_depth, listed (rows to set), structural, regularised and collecting (0 or 1).
    """
    assert (variant.appearance, variant.weights) == ("splats", None), variant
    step = {"step": _step(variant), "errors": _errors(variant), "learn colours": _LEARN_COLOURS}
    sequences = step | _row_sequences()
    buffers = rendering_buffers(variant) | training_buffers(variant)
    described = _described(variant, buffers, _rendering_sequences(variant) | sequences)
    structs = {"update": ("Update", "adam"), "rows": ("Rows", "gather_rows")}
    uniforms = {
        name: UniformLayout.of(struct, described.shaders[shader].source) for name, (struct, shader) in structs.items()
    }
    return replace(described, uniforms={**described.uniforms, **uniforms})


def _rendering_sequences(variant: Variant) -> dict[str, Sequence]:
    bins = bin_passes() if variant.weights is None else bin_passes(sort=())
    buffers = rendering_buffers(variant)
    cleared = tuple(name for name in (*CLEARED, "largest_exponents") if name in buffers)
    return {
        "render": Sequence(cleared, (*bins, _RASTERIZE)),
        "render depth": Sequence(cleared, (*bins, _RASTERIZE_DEPTH)),
        "list splats": Sequence(cleared, tuple(bins)),
        "draw tiles": Sequence((), (replace(_RASTERIZE, groups="drawn_tiles"),)),
        "draw tiles depth": Sequence((), (replace(_RASTERIZE_DEPTH, groups="drawn_tiles"),)),
    }


def _described(variant: Variant, buffers: dict[str, str], sequences: dict[str, Sequence]) -> Description:
    """The description of sequences, through the variant's lenses, with their shaders and the camera's uniforms."""
    through = {
        name: replace(one, passes=tuple(through_lenses(one.passes, variant.lenses))) for name, one in sequences.items()
    }
    shaders = {name: _shader(name, variant) for name in shader_names(through.values())}
    uniforms = camera_uniforms(shaders["project"])
    if variant.weights is not None:
        uniforms["weighting"] = UniformLayout.of("Weighting", shaders["project"].source)
    return Description(DEFINITIONS, buffers, uniforms, shaders, through)


def _shader(name: str, variant: Variant) -> Shader:
    """Only a rasterization that is replayed later fills a cache."""
    if name == "rasterize_for_replay":
        return replace(link("rasterize", variant.sections), name=name)
    return link(name, {**variant.sections, "replay.record": "replay.record_nothing"})


def camera_uniforms(project: Shader) -> dict[str, UniformLayout]:
    """The layouts of the uniform buffers of a camera, from the shader that projects."""
    return {struct.lower(): UniformLayout.of(struct, project.source) for struct in ("View", "Lens")}
