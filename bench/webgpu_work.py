"""The work of a WebGPU step for one view: splats, intersections, pairs, bytes, operations.

A pair is one splat at one pixel. Visited pairs are those at which a shader evaluates a splat's exponent; contributing
ones have an alpha of at least 1/255 at a pixel that is not saturated.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit, prange

from pocketgs.capture import Frame
from pocketgs.gpu.sizes import Symbols, ceil_div, evaluate
from pocketgs.gpu.workgroups import BLOCK, DIGIT_BITS
from pocketgs.splat.constants import ALPHA_MAX, ALPHA_MIN, TRANSMITTANCE_MIN
from pocketgs.splat.engine import EngineOptions
from pocketgs.splat.settings import StepSettings
from pocketgs.splat.webgpu.engine import WebGpuEngine
from pocketgs.splat.webgpu.layout import RECORD_WORDS, SPLAT_WORDS, TILE

TILE_PIXELS = TILE * TILE
LOG2_ALPHA_MIN = float(np.log2(ALPHA_MIN))

DEPTH_DIGITS = 32 // DIGIT_BITS

TRAFFIC = {
    "clear": ("0", "36 * rows_cleared + 4 * tiles"),
    "bound clusters": ("24 * gaussians", "32 * groups"),
    "cull": ("32 * groups", "4 * groups"),
    "project": ("44 * in_view + 12 * coefficients * visible", "12 * in_view + splat_bytes * visible"),
    "count digits of depth_keys": ("depth_digits * 4 * in_view", "depth_digits * 64 * blocks"),
    "place depth_keys": ("depth_digits * 64 * blocks", "depth_digits * 64 * blocks"),
    "scatter depth_keys": ("depth_digits * (8 * in_view + 64 * blocks)", "depth_digits * 8 * in_view"),
    "sum blocks of tile_counts": ("8 * in_view", "4 * blocks"),
    "place blocks of tile_counts": ("4 * blocks", "4 * blocks"),
    "place tile_counts": ("8 * in_view + 4 * blocks", "4 * in_view"),
    "emit": ("4 * in_view + (4 + splat_bytes) * visible", "12 * listed"),
    "count digits of tile_keys": ("tile_digits * 4 * listed", "tile_digits * 64 * listed_blocks"),
    "place tile_keys": ("tile_digits * 64 * listed_blocks", "tile_digits * 64 * listed_blocks"),
    "scatter tile_keys": ("tile_digits * (8 * listed + 64 * listed_blocks)", "tile_digits * 8 * listed"),
    "tile ranges": ("4 * listed", "4 * tiles"),
    "rasterize": ("4 * tiles + 8 * drawn + splat_bytes * drawn_splats", "16 * pixels + 8 * tiles + cache_bytes"),
    "dssim": ("20 * pixels", "36 * pixels"),
    "loss": ("20 * pixels + 36 * structural * pixels", "16 * pixels"),
    "clear rows": ("0", "36 * (rows_read - rows_cleared)"),
    "rasterize backward": (
        "8 * tiles + 32 * pixels + 8 * drawn + splat_bytes * drawn_splats + cache_bytes + 36 * rows_added_to",
        "36 * rows_written",
    ),
    "project backward": (
        "4 * in_view + (48 + 12 * coefficients + splat_bytes) * visible + 36 * rows_read",
        "4 * columns * in_view",
    ),
    "collect statistics": ("4 * in_view + (20 + splat_bytes) * visible + 36 * rows_read", "12 * visible"),
    "write error": ("20 * pixels", "16 * pixels"),
    "collect errors": ("4 * in_view + 12 * visible + 36 * rows_read", "4 * visible"),
    "regularise": ("32 * gaussians", "16 * gaussians"),
    "adam": (
        "4 * columns * in_view + (8 * columns + 44 + 12 * coefficients) * drawn_splats",
        "(8 * columns + 44 + 12 * coefficients) * drawn_splats",
    ),
    "sum loss": ("8 * patches", "0"),
}
"""Bytes that each pass must read and write, assuming that repeated reads hit a cache.

Besides the numbers of the engine's own expressions: Gaussians of clusters `in_view`, `visible` Gaussians that stand in
at least one list, `listed` intersections of all lists, `drawn` intersections up to the last that contributes in its
tile, `drawn_splats` different splats among these, rows of gradients, and bytes of the replay cache in use. Passes that
are not named move next to nothing. All clusters are bounded anew, as after a step in which all have moved.
"""

FLOPS_PER_PAIR = {
    "rasterize": (10, 11),
    "rasterize backward, recompute": (10, 36),
    "rasterize backward, cache": (2, 38),
}
"""Operations at a visited pair, and those that a contributing one adds; exp2, min and / count as one each.

Visited: the offset from the centre 2, the exponent 8; a cache has no exponent. Contributing, forward: α 3, its weight
1, the colour 6, the transmittance 1. Backward: α 3 unless cached, its weight 1, c · ∂L/∂C and the gain 6, what lies
behind 1 (from a cache 6), the transmittance 1, ∂L/∂(ln α) 4, sums 20.
"""


@dataclass(frozen=True)
class Work:
    """Counts of one step, or their means over several views.

    Attributes:
        in_view, visible, listed, drawn, drawn_splats: see `TRAFFIC`.
        forward_pairs, backward_pairs: visited by rasterization and its reverse.
        contributing_pairs: of either.
        contributions: (H, W) by pixel, of the first view.
    """

    in_view: int
    visible: int
    listed: int
    drawn: int
    drawn_splats: int
    forward_pairs: int
    backward_pairs: int
    contributing_pairs: int
    contributions: np.ndarray

    def bytes_moved(self, symbols: Symbols, options: EngineOptions) -> dict[str, int]:
        """Bytes that each pass has to move at least, read and written together, by its name.

        Args:
            symbols: that the step was submitted with.
            options: of the engine.
        """
        ordered, cached = options.accumulation == "ordered", options.replay == "cache"
        rows = self.drawn if ordered else self.drawn_splats
        recorded = int(np.minimum(self.contributions, symbols["replay_depth"]).sum())
        known = {
            **symbols,
            "in_view": self.in_view,
            "visible": self.visible,
            "listed": self.listed,
            "listed_blocks": ceil_div(self.listed, BLOCK),
            "drawn": self.drawn,
            "drawn_splats": self.drawn_splats,
            "depth_digits": DEPTH_DIGITS,
            "tile_digits": 2 * ceil_div(symbols["tiles"].bit_length(), 2 * DIGIT_BITS),
            "splat_bytes": 4 * SPLAT_WORDS[options.precision],
            "cache_bytes": 4 * symbols["pixels"] + 4 * RECORD_WORDS[options.precision] * recorded if cached else 0,
            "rows_cleared": 0 if ordered else symbols["capacity"],
            "rows_written": rows,
            "rows_added_to": 0 if ordered else rows,
            "rows_read": self.listed if ordered else self.visible,
        }
        return {name: sum(evaluate(part, known) for part in parts) for name, parts in TRAFFIC.items()}

    def flops(self, options: EngineOptions) -> Mapping[str, int]:
        """Floating-point operations of the two passes over pairs, by the pass's name."""
        pairs = {"rasterize": self.forward_pairs, "rasterize backward": self.backward_pairs}
        per_pair = {
            "rasterize": FLOPS_PER_PAIR["rasterize"],
            "rasterize backward": FLOPS_PER_PAIR[f"rasterize backward, {options.replay}"],
        }
        return {
            name: visited * per_pair[name][0] + self.contributing_pairs * per_pair[name][1]
            for name, visited in pairs.items()
        }


def count_work(engine: WebGpuEngine, frames: Sequence[Frame], settings: StepSettings) -> Work:
    """Take a step on each of the frames, which are the engine's first views, and count what it had to do.

    Args:
        engine: with a scene and views, and splats in full precision.
        frames: some.
        settings: with rates of 0, so that the scene stays as it is.
    """
    works = [_count_view(engine, view, frame, settings) for view, frame in enumerate(frames)]
    names = [name for name in Work.__dataclass_fields__ if name != "contributions"]
    means = {name: round(float(np.mean([getattr(work, name) for work in works]))) for name in names}
    return Work(**means, contributions=works[0].contributions)


def _count_view(engine: WebGpuEngine, view: int, frame: Frame, settings: StepSettings) -> Work:
    engine.step(view, settings)
    engine.loss()
    read, camera = engine.executor.read, frame.camera
    count = len(engine.download())
    tiles = ceil_div(camera.width, TILE) * ceil_div(camera.height, TILE)
    starts = read("tile_starts", np.uint32, tiles + 1)
    listed, ranks = (int(number) for number in read("intersection_count", np.uint32, 2))
    intersection_splats = read("slot_splats", np.uint32, listed)[read("slots", np.uint32, listed)]
    splats = read("splats", np.float32, 10 * count).reshape(count, 10)
    forward, ends, contributions = _replay(splats, intersection_splats, starts, camera.width, camera.height)
    in_tiles = [intersection_splats[start:end] for start, end in zip(starts, ends, strict=False)]
    drawn = int((ends - starts[:-1]).sum())
    return Work(
        in_view=ranks,
        visible=int(np.count_nonzero(read("tile_counts", np.uint32, count)[read("order", np.uint32, ranks)])),
        listed=listed,
        drawn=drawn,
        drawn_splats=len(np.unique(np.concatenate(in_tiles))),
        forward_pairs=int(forward.sum()),
        backward_pairs=TILE_PIXELS * drawn,
        contributing_pairs=int(contributions.sum()),
        contributions=contributions,
    )


@njit(parallel=True)
def _replay(
    splats: np.ndarray, intersection_splats: np.ndarray, starts: np.ndarray, width: int, height: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Go through the lists as `rasterize.wgsl` does, in batches, until no pixel of the tile takes any more.

    Returns:
        By tile: visited pairs, and the end of what was drawn; and by pixel its contributions, (H, W).
    """
    tiles = len(starts) - 1
    across = -(-width // TILE)
    visited, ends = np.zeros(tiles, np.int64), starts[:-1].copy()
    contributions = np.zeros((height, width), np.int64)
    for tile in prange(tiles):
        left, top = tile % across * TILE, tile // across * TILE
        right, bottom = min(left + TILE, width), min(top + TILE, height)
        transmittance = np.ones((TILE, TILE))
        for intersection in range(starts[tile], starts[tile + 1]):
            in_batch = (intersection - starts[tile]) % TILE_PIXELS
            if in_batch == 0 and transmittance[: bottom - top, : right - left].max() < TRANSMITTANCE_MIN:
                break
            visited[tile] += TILE_PIXELS
            x, y, _, log2_opacity, xx, xy, yy = splats[intersection_splats[intersection]][:7]
            for row in range(top, bottom):
                for column in range(left, right):
                    dx, dy = column + 0.5 - x, row + 0.5 - y
                    exponent = log2_opacity + xx * dx * dx + xy * dx * dy + yy * dy * dy
                    in_front = transmittance[row - top, column - left]
                    if exponent >= LOG2_ALPHA_MIN and in_front >= TRANSMITTANCE_MIN:
                        transmittance[row - top, column - left] -= min(2.0**exponent, ALPHA_MAX) * in_front
                        contributions[row, column] += 1
                        ends[tile] = intersection + 1
    return visited, ends, contributions
