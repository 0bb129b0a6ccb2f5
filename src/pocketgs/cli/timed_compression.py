"""Compression on the chosen engine, within what is left of a time budget."""

from __future__ import annotations

from collections.abc import Callable

from pocketgs.compression.compress import Compressed, compress
from pocketgs.compression.options import CompressionOptions
from pocketgs.compression.views import Views
from pocketgs.scene.gaussians import Gaussians
from pocketgs.splat.choose_engine import chosen_engine
from pocketgs.splat.engine import Engine, EngineOptions
from pocketgs.splat.rasterizer import Rasterizer
from pocketgs.system.process import seconds_since_start

WRITING_SECONDS = 3.0
"""What is left of a time budget for the files, besides the renderings of the table."""


def compress_in_time(
    scene: Gaussians,
    views: Views,
    engine: Engine,
    options: CompressionOptions,
    *,
    engine_options: EngineOptions,
    time_budget: float | None,
    on_count: Callable[[int, int], None],
) -> Compressed:
    """Compress a scene within what is left of a time budget.

    Args:
        scene: the original.
        views: as for `compress`.
        engine: trains and renders.
        options: of the compression.
        engine_options: of the engine, for the rasterizer that computes the Gaussians' contributions.
        time_budget: seconds from the start of the program, or None.
        on_count: as for `compress`.

    Raises:
        PocketGSError: as `compress`.
    """
    return compress(
        scene,
        views,
        engine,
        options,
        rasterizer=Rasterizer(chosen_engine(engine_options), engine_options.threads, engine_options.gpu),
        seconds=None if time_budget is None else max(time_budget - seconds_since_start() - WRITING_SECONDS, 1.0),
        on_count=on_count,
    )
