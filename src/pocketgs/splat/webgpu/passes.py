"""The passes of rendering and of a training step, in their order."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from typing import Literal

from pocketgs.gpu.description import Description, Pass, Sequence, shader_names
from pocketgs.gpu.shader_library import Shader
from pocketgs.gpu.sort import Items, digit_counts_bytes, radix_sort, running_sums
from pocketgs.gpu.uniforms import UniformLayout
from pocketgs.gpu.workgroups import BLOCK, DIGIT_BITS, THREADS
from pocketgs.splat.colours import COLUMNS
from pocketgs.splat.engine import KEPT_LOSSES, Accumulation, Precision, Replay
from pocketgs.splat.webgpu.layout import (
    BOUND_WORDS,
    GRADIENT_COLUMNS,
    PATCH,
    RECORD_WORDS,
    SHAPE_COLUMNS,
    SPLAT_WORDS,
    SUM_WORDS,
    TILE,
)
from pocketgs.splat.webgpu.lenses import PINHOLE, link, through_lenses

DEFINITIONS = {
    "pixels": "width * height",
    "tiles": f"ceil_div(width, {TILE}) * ceil_div(height, {TILE})",
    "patches": f"ceil_div(width, {PATCH}) * ceil_div(height, {PATCH})",
    "columns": f"{GRADIENT_COLUMNS} + 3 * coefficients",
    "groups": f"ceil_div(gaussians, {THREADS})",
    "blocks": f"ceil_div(gaussians, {BLOCK})",
    "intersection_blocks": f"ceil_div(intersections, {BLOCK})",
}


Appearance = Literal["splats", "points", "discs"]
Weights = Literal["direct", "exponential", "lc", "mobile", "visibility"]

COVERAGES: dict[Weights, str] = {
    "direct": "weighted.against_background",
    "exponential": "weighted.against_background",
    "lc": "weighted.against_background",
    "mobile": "weighted.by_transmittance",
    "visibility": "weighted.by_transmittance",
}
"""Rule for the share of the background that shows, by weights: see `common/weighted.wgsl`."""


@dataclass(frozen=True)
class Variant:
    """Variant of the passes.

    Attributes:
        precision: of splats and of the replay cache.
        replay: whether the backward pass recomputes α, "recompute", or reads it from the forward pass's "cache".
        accumulation: how tiles' gradients are summed: "ordered", in rows that are added up later, or "atomic".
        subgroups: whether threads of a subgroup add up without workgroup memory.
        appearance: shape that Gaussians are drawn as; training always draws splats.
        weights: weights of Gaussians without sorting, for rendering only; None to sort.
        lenses: lenses that cameras may have: PINHOLE or LENSES.
    """

    precision: Precision = "f32"
    replay: Replay = "recompute"
    accumulation: Accumulation = "ordered"
    subgroups: bool = False
    appearance: Appearance = "splats"
    weights: Weights | None = None
    lenses: tuple[str, ...] = PINHOLE

    @property
    def sections(self) -> dict[str, str]:
        """From the shaders' interfaces to the sections that implement them."""
        cached = self.replay == "cache"
        return {
            "splats.words": f"splats.words_{self.precision}",
            "replay.words": f"replay.words_{self.precision}",
            "replay.source": "replay.from_cache" if cached else "replay.by_recomputing",
            "replay.record": "replay.record_in_cache" if cached else "replay.record_nothing",
            "compositor.forward": "over.forward",
            "compositor.backward": "over.backward",
            "compositor.inspection": "over.inspection",
            "channels.kind": "channels.colour",
            "gradient_rows.add": f"gradient_rows.add_{self.accumulation}",
            "gradient_rows.gather": f"gradient_rows.gather_{self.accumulation}",
            "appearance.kind": f"appearance.{self.appearance}",
            "scan.exclusive": "scan.subgroup" if self.subgroups else "scan.shared",
            "depth_keys.kind": "depth_keys.written",
            "weights.kind": "weights.none",
            "weights.finished": "weights.as_made",
            **self._weighted,
        }

    @property
    def _weighted(self) -> dict[str, str]:
        """The sections of drawing without sorting."""
        if self.weights is None:
            return {}
        assert self.precision == "f32", "weights are stored in full precision"
        return {
            "splats.words": "splats.words_weighted",
            "compositor.forward": "weighted.forward",
            "weighted.coverage": COVERAGES[self.weights],
            "depth_keys.kind": "depth_keys.none",
            "weights.kind": f"weights.{self.weights}",
            "weights.finished": "weights.by_largest" if self.weights == "visibility" else "weights.as_made",
        }

    @property
    def features(self) -> frozenset[str]:
        """Optional features that a device must have."""
        needed = {"subgroup": self.subgroups, "shader-float32-atomic": self.accumulation == "atomic"}
        return frozenset(feature for feature, is_needed in needed.items() if is_needed)


STATISTICS = 4
"""Columns of sums: see `common/statistics.wgsl`."""


def rendering_buffers(variant: Variant) -> dict[str, str]:
    """Sizes in bytes of the buffers that rendering needs."""
    buffers = _sorted_buffers(variant)
    if variant.weights is not None:
        for name in ("depth_keys", *SORTING_BUFFERS):
            del buffers[name]
        buffers["splats"] = f"{4 * SPLAT_WORDS['weighted']} * capacity"
        buffers["views"] = "4 * view_coefficients * capacity"
    if variant.weights == "visibility":
        buffers["largest_exponents"] = "8"
    return buffers


SORTING_BUFFERS = ("depth_keys_spare", "order_spare", "depth_digit")
"""Buffers that only sorting by depth needs."""


def _sorted_buffers(variant: Variant) -> dict[str, str]:
    return {
        "shape": f"{4 * SHAPE_COLUMNS} * capacity",
        "sh": "12 * coefficients * capacity",
        "splats": f"{4 * SPLAT_WORDS[variant.precision]} * capacity",
        "depth_keys": "4 * capacity",
        "depth_keys_spare": "4 * capacity",
        "order": "4 * capacity",
        "order_spare": "4 * capacity",
        "tile_counts": "4 * capacity",
        "block_sums": f"4 * ceil_div(capacity, {BLOCK})",
        "first_slots": "4 * capacity + 4",
        "digit_counts": digit_counts_bytes(f"max(ceil_div(capacity, {BLOCK}), intersection_blocks)"),
        "depth_digit": "8",
        "tile_digit": "8",
        "cluster_bounds": f"{4 * BOUND_WORDS} * ceil_div(capacity, {THREADS})",
        "cluster_places": f"4 * ceil_div(capacity, {THREADS})",
        "gaussian_count": "4",
        "intersection_count": "8",
        "intersection_dispatches": "24",
        "status": "12",
        "tile_keys": "4 * intersections",
        "tile_keys_spare": "4 * intersections",
        "slots": "4 * intersections",
        "slots_spare": "4 * intersections",
        "slot_splats": "4 * intersections",
        "tile_starts": "4 * tiles + 8",
        "drawn_ranges": "8 * tiles",
        "image": "16 * pixels",
    }


_TRAINING_BUFFERS = {
    "gradients": "4 * columns * capacity",
    "first_moments": "4 * columns * capacity",
    "second_moments": "4 * columns * capacity",
    "statistics": f"{4 * STATISTICS} * capacity",
    "row_sources": "4 * capacity",
    "listed_rows": "4 * listed",
    "listed_values": "4 * listed * max(4, 3 * coefficients)",
    "photographs": "4 * photograph_pixels",
    "ssim_derivatives": "36 * pixels",
    "d_image": "16 * pixels",
    "loss_parts": "8 * patches",
    "colours": f"{4 * COLUMNS} * photographs",
    "colour_parts": "48 * patches",
    "regulariser_parts": f"4 * ceil_div(capacity, {THREADS})",
    "losses": f"{4 * KEPT_LOSSES}",
}


_GAUSSIANS = Items("gaussian_count", blocks="blocks")
_INTERSECTIONS = Items("intersection_count", indirect=("intersection_dispatches", 0))


def _tiles_have_digit(shift: int) -> str:
    """Whether the tiles' numbers, and one more that stands for no tile, reach a digit or its neighbour in the pair."""
    return f"tiles + 1 > {1 << (shift - shift % (2 * DIGIT_BITS))}"


def bin_passes(by_depth: bool = True) -> list[Pass]:
    """Everything before rasterizing: tiles' lists of splats, nearest first or, without depth, as they lie in memory."""
    return [
        Pass("bound clusters", "bound_clusters", "groups"),
        Pass("cull", "cull", "1"),
        Pass("project", "project", "groups"),
        *list_passes(by_depth),
    ]


def list_passes(by_depth: bool = True) -> list[Pass]:
    """Tiles' lists from projected splats, and the number of tiles that each reaches."""
    by_depth_passes = radix_sort(_GAUSSIANS, "depth_keys", "order", "depth_digit", 32, lambda _: "1")
    return [
        *(by_depth_passes if by_depth else ()),
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
            Pass("learn colours", "learn_colours", "1", when="colours_learned"),
            *replayed,
            Pass("project backward", "project_backward", "groups"),
            Pass("collect statistics", "collect_statistics", "groups", when="collecting"),
            Pass("regularise", "regularise", "groups", when="regularised"),
            Pass("adam", "adam", "groups"),
            Pass("sum loss", "sum_loss", "1"),
        ),
    )


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
"""Buffer that table rows are gathered in; free between steps."""


def _row_sequences() -> dict[str, Sequence]:
    """Sequences that gather the rows of each table, and that set some of them."""
    sequences: dict[str, Sequence] = {}
    for table in TABLES:
        buffers = {"table": table, "gathered": GATHERED}
        gather = Pass(f"gather {table}", "gather_rows", "groups", buffers=buffers)
        set_rows = Pass(f"set {table}", "set_rows", f"ceil_div(listed, {THREADS})", buffers={"table": table})
        sequences |= {gather.name: Sequence((), (gather,)), set_rows.name: Sequence((), (set_rows,))}
    return sequences


@cache
def describe(variant: Variant, training: bool = True) -> Description:
    """Describe rendering, and training if asked for.

    The numbers that the expressions are computed from: gaussians, capacity (room for them), coefficients,
    view_coefficients (of weights, where there are any), width, height, intersections (room for them), photographs,
    photograph_pixels, replay_depth, listed (rows to set), structural, regularised, collecting and colours_learned (0 or
    1); those of `lens_symbols`, where cameras may have a lens; and for a rasterization of some of the tiles,
    drawn_tiles, their number.
    """
    assert not training or (variant.appearance == "splats" and variant.weights is None), variant
    bins = bin_passes(variant.weights is None)
    buffers = rendering_buffers(variant)
    cleared = tuple(name for name in (*CLEARED, "largest_exponents") if name in buffers)
    sequences = {
        "render": Sequence(cleared, (*bins, _RASTERIZE)),
        "render depth": Sequence(cleared, (*bins, _RASTERIZE_DEPTH)),
        "list splats": Sequence(cleared, tuple(bins)),
        "draw tiles": Sequence((), (replace(_RASTERIZE, groups="drawn_tiles"),)),
        "draw tiles depth": Sequence((), (replace(_RASTERIZE_DEPTH, groups="drawn_tiles"),)),
    }
    if training:
        sequences["step"] = _step(variant)
        sequences["errors"] = _errors(variant)
        sequences |= _row_sequences()
        buffers |= _TRAINING_BUFFERS
        if variant.replay == "cache":
            buffers["replay_cache"] = f"pixels * (4 + {4 * RECORD_WORDS[variant.precision]} * replay_depth)"
        rows = "intersections" if variant.accumulation == "ordered" else "capacity"
        buffers["gradient_rows"] = f"{4 * SUM_WORDS} * {rows}"
    sequences = {
        name: replace(one, passes=tuple(through_lenses(one.passes, variant.lenses))) for name, one in sequences.items()
    }
    shaders = {name: _shader(name, variant) for name in shader_names(sequences.values())}
    uniforms = camera_uniforms(shaders["project"])
    if training:
        uniforms["update"] = UniformLayout.of("Update", shaders["adam"].source)
        uniforms["rows"] = UniformLayout.of("Rows", shaders["gather_rows"].source)
    if variant.weights is not None:
        uniforms["weighting"] = UniformLayout.of("Weighting", shaders["project"].source)
    return Description(DEFINITIONS, buffers, uniforms, shaders, sequences)


def _shader(name: str, variant: Variant) -> Shader:
    """Only a rasterization that is replayed later fills a cache."""
    if name == "rasterize_for_replay":
        return replace(link("rasterize", variant.sections), name=name)
    return link(name, {**variant.sections, "replay.record": "replay.record_nothing"})


def camera_uniforms(project: Shader) -> dict[str, UniformLayout]:
    """The layouts of the uniform buffers of a camera, from the shader that projects."""
    return {struct.lower(): UniformLayout.of(struct, project.source) for struct in ("View", "Lens")}
