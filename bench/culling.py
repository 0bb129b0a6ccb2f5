"""Benchmark of cluster culling: a step that sees a tenth of a scene, with culling and without.

    python bench/culling.py

The scene is a street of ten blocks, and the camera sees one of them. Steps alternate between three variants: with
culling; without, where Adam still skips Gaussians without visible pixels; and as in 3DGS, without culling and with Adam
on all Gaussians. Medians are printed by pass, with their ratio to those with culling.
"""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import tyro
from rich.console import Console
from rich.table import Table

from cpu_step import PASSES, random_scene
from pocketgs.capture import Frame
from pocketgs.scene.gaussians import Gaussians
from pocketgs.scene.morton import morton_order
from pocketgs.splat.cpu.clusters import Clusters
from pocketgs.splat.cpu.engine import CpuEngine
from pocketgs.splat.cpu.layout import View
from pocketgs.splat.cpu.lenses.lens import KernelLens
from pocketgs.splat.settings import StepSettings
from pocketgs.splat.timing import PassTimer
from pocketgs.training.recipes import recipe_named

BLOCKS = 10
SPACING = 3.0
SH_DEGREE = 2


class AllInView(Clusters):
    """Clusters that are never culled."""

    def in_view(self, scene: Gaussians, view: View, lens: KernelLens, near: float, threads: int) -> np.ndarray:
        """All clusters, without checking their bounds."""
        return self.all


def main(gaussians: int = 1_000_000, width: int = 504, height: int = 378, rounds: int = 10) -> None:
    """Print the table.

    Args:
        gaussians: Gaussians of the whole scene.
        width: Of the image, in pixels.
        height: Of the image, in pixels.
        rounds: Steps timed per variant.
    """
    scene, frame = street(gaussians, width, height)
    recipe = recipe_named("pocketgs")
    sparse = StepSettings(recipe.rates.scaled(0.0), recipe.loss, replace(recipe.adam, seen_only=True))
    dense = replace(sparse, adam=replace(recipe.adam, seen_only=False))
    ways = {
        "with culling": (opened(scene, frame, Clusters), sparse),
        "without": (opened(scene, frame, AllInView), sparse),
        "without, Adam on all": (opened(scene, frame, AllInView), dense),
    }
    for _ in range(rounds + 1):
        for engine, settings in ways.values():
            step(engine, settings)
    table = Table(f"{gaussians:,} Gaussians, a tenth in view, {width}x{height}: ms", *PASSES, "step")
    culled: dict[str, float] = {}
    for way, (engine, _) in ways.items():
        found = {name: float(np.median(times[1:])) for name, times in engine.timer.milliseconds.items()}
        culled = culled or found
        table.add_row(way, *(f"{found[name]:.1f} ({found[name] / culled[name]:.1f}x)" for name in (*PASSES, "step")))
    Console(width=220).print(table)


def street(count: int, width: int, height: int) -> tuple[Gaussians, Frame]:
    """Ten random scenes beside each other in Morton order, and a view that sees the first."""
    block, (frame,) = random_scene(count // BLOCKS, width, height)
    means = np.concatenate([block.means + np.array([SPACING * i, 0.0, 0.0]) for i in range(BLOCKS)])
    order = morton_order(means)
    rng = np.random.default_rng(1)
    sh = rng.normal(0.0, 0.3, (len(means), (SH_DEGREE + 1) ** 2, 3))
    log_scales, quaternions = (np.tile(part, (BLOCKS, 1)) for part in (block.log_scales, block.quaternions))
    return Gaussians(means, log_scales, quaternions, np.tile(block.opacity_logits, BLOCKS), sh).select(order), frame


def opened(scene: Gaussians, frame: Frame, clusters: type[Clusters]) -> CpuEngine:
    """An engine with this kind of culling."""
    engine = CpuEngine()
    engine.set_views([frame])
    engine.upload(scene)
    engine._clusters = clusters(len(scene))
    engine.timer = PassTimer()
    return engine


def step(engine: CpuEngine, settings: StepSettings) -> None:
    """One step, timed as a whole too."""
    started = time.perf_counter()
    engine.step(0, settings)
    engine.timer.milliseconds["step"].append(1e3 * (time.perf_counter() - started))


if __name__ == "__main__":
    tyro.cli(main)
