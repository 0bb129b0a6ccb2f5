"""The buffers of rendering and of training, and the expressions that their sizes are computed from."""

from __future__ import annotations

from pocketgs.gpu.sort import digit_counts_bytes
from pocketgs.gpu.workgroups import BLOCK, THREADS
from pocketgs.splat.colours import COLUMNS
from pocketgs.splat.engine import KEPT_LOSSES
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
from pocketgs.splat.webgpu.variant import Variant

DEFINITIONS = {
    "pixels": "width * height",
    "tiles": f"ceil_div(width, {TILE}) * ceil_div(height, {TILE})",
    "patches": f"ceil_div(width, {PATCH}) * ceil_div(height, {PATCH})",
    "columns": f"{GRADIENT_COLUMNS} + 3 * coefficients",
    "groups": f"ceil_div(gaussians, {THREADS})",
    "blocks": f"ceil_div(gaussians, {BLOCK})",
    "intersection_blocks": f"ceil_div(intersections, {BLOCK})",
}

STATISTICS = 4
"""Columns of sums: see `common/statistics.wgsl`."""


def rendering_buffers(variant: Variant) -> dict[str, str]:
    """Sizes in bytes of the buffers that rendering needs, as expressions."""
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
    "photographs": "4 * photograph_pixels",
    "ssim_derivatives": "36 * pixels",
    "d_image": "16 * pixels",
    "loss_parts": "8 * patches",
    "colours": f"{4 * COLUMNS} * photographs",
    "colour_parts": "48 * patches",
    "regulariser_parts": f"4 * ceil_div(capacity, {THREADS})",
    "losses": f"{4 * KEPT_LOSSES}",
}


def training_buffers(variant: Variant) -> dict[str, str]:
    """Sizes in bytes of the buffers that training needs besides, as expressions."""
    buffers = dict(_TRAINING_BUFFERS)
    if variant.replay == "cache":
        buffers["replay_cache"] = f"pixels * (4 + {4 * RECORD_WORDS[variant.precision]} * replay_depth)"
    rows = "intersections" if variant.accumulation == "ordered" else "capacity"
    buffers["gradient_rows"] = f"{4 * SUM_WORDS} * {rows}"
    return buffers
