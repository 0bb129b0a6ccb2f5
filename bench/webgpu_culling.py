"""Time steps of the WebGPU engine with and without culling by clusters, on a scene that views see partly.

    python bench/webgpu_culling.py --gaussians 300000 --share 0.1

Steps with and without culling take turns; without, every cluster has bounds that no view misses. Passes are timed as in
`webgpu_step.py`.
"""

from __future__ import annotations

import time

import numpy as np
import tyro
from rich.console import Console
from rich.table import Table

from cpu_step import random_scene
from pocketgs.capture import Frame
from pocketgs.gpu.sizes import ceil_div
from pocketgs.gpu.timing import PassTimes
from pocketgs.gpu.workgroups import THREADS
from pocketgs.scene.gaussians import PARAMETERS, Gaussians
from pocketgs.scene.morton import morton_order
from pocketgs.splat.engine import EngineOptions
from pocketgs.splat.settings import AdamSettings, StepSettings
from pocketgs.splat.webgpu.engine import WebGpuEngine
from pocketgs.training.recipes import recipe_named

GROUPS = {
    "bounds, cull": ("bound clusters", "cull"),
    "project": ("project",),
    "sort by depth": ("count digits of depth_keys", "place depth_keys", "scatter depth_keys"),
    "project backward": ("project backward",),
    "adam": ("adam",),
}
"""Passes that depend on the number of Gaussians, as they are printed."""


def main(
    gaussians: int = 300_000,
    share: float = 0.1,
    width: int = 96,
    height: int = 72,
    steps: int = 10,
    gpu: str | None = None,
) -> None:
    """Print milliseconds by pass with and without culling, and their ratios.

    Args:
        gaussians: How many there are.
        share: Of them in view.
        width: Of the image.
        height: Of the image.
        steps: Steps timed of each kind, after one of each.
        gpu: Part of the GPU's name; by default the best.
    """
    scene, frame = scene_around(gaussians, share, width, height)
    engines = {culls: WebGpuEngine(EngineOptions("webgpu", gpu=gpu, max_memory=8000)) for culls in (True, False)}
    for engine in engines.values():
        engine.prepare()
        engine.set_views([frame])
        engine.upload(scene)
    recipe = recipe_named("pocketgs")
    settings = StepSettings(recipe.rates.scaled(0.0), recipe.loss, AdamSettings(seen_only=True))
    times = {culls: _timed(engine, settings, culls) for culls, engine in engines.items()}
    whole_steps: dict[bool, list[float]] = {True: [], False: []}
    for _ in range(steps):
        for culls, engine in engines.items():
            for name, values in _timed(engine, settings, culls).milliseconds.items():
                times[culls].milliseconds[name] += values
            _prepare(engine, culls)
            began = time.perf_counter()
            engine.step(0, settings)
            engine.loss()
            whole_steps[culls].append(1e3 * (time.perf_counter() - began))
    table = Table(
        "ms",
        *GROUPS,
        "all passes",
        "a step",
        title=f"{engines[True].device}, {gaussians:,} Gaussians, {share:.0%} in view",
    )
    rows = {}
    for culls, total in times.items():
        medians = {name: float(np.median(values[1:])) for name, values in total.milliseconds.items()}
        rows[culls] = [sum(medians[name] for name in names) for names in GROUPS.values()]
        rows[culls] += [sum(medians.values()), float(np.median(whole_steps[culls]))]
        table.add_row("culled" if culls else "whole", *(f"{value:.2f}" for value in rows[culls]))
    table.add_row(
        "whole / culled", *(f"{whole / culled:.2f}" for culled, whole in zip(rows[True], rows[False], strict=True))
    )
    Console(width=160).print(table)


def _timed(engine: WebGpuEngine, settings: StepSettings, culls: bool) -> PassTimes:
    """One step, by pass."""
    _prepare(engine, culls)
    with engine.executor.timed() as times:
        engine.step(0, settings)
        engine.loss()
    return times


def _prepare(engine: WebGpuEngine, culls: bool) -> None:
    """Let every cluster be in view, unless it is to be culled. Wait until that is done."""
    if not culls:
        everything = np.array([-1e30] * 3 + [1e30] * 3 + [0.0, 1.0], np.float32)
        engine.executor.write("cluster_bounds", np.tile(everything, ceil_div(engine.count, THREADS)))
    engine.executor.read("status", np.uint32, 1)


def scene_around(count: int, share: float, width: int, height: int) -> tuple[Gaussians, Frame]:
    """The scene of `cpu_step.py` in view, and copies of it around, in the order of a Morton curve."""
    seen, (frame,) = random_scene(round(count * share), width, height)
    rng = np.random.default_rng(1)
    rows = np.arange(count) % len(seen)
    scene = Gaussians(*(getattr(seen, name)[rows] for name in PARAMETERS))
    away = np.arange(count) >= len(seen)
    scene.means[away, 0] += np.float32(10.0) * rng.integers(1, 10, int(away.sum()))
    return scene.select(morton_order(scene.means)), frame


if __name__ == "__main__":
    tyro.cli(main)
