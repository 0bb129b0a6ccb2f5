"""One training step of the CPU engine: time by pass, splat-pixel pairs per second, memory.

    python bench/cpu_step.py                                    # random scenes of several sizes
    python bench/cpu_step.py ../data/fern --images images_8     # a capture

A capture's scene is its own sparse cloud after 100 iterations, one Gaussian per point, so that rows are comparable
between versions with different defaults.

See `pairs` for visited and contributing pairs.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from rich.console import Console
from rich.table import Table

from pairs import count_pairs
from pocketgs.capture import Frame
from pocketgs.capture.options import CaptureOptions
from pocketgs.cli.capture_options import read_capture
from pocketgs.geometry.camera import Camera, look_at
from pocketgs.scene.gaussians import Gaussians
from pocketgs.splat.cpu.engine import CpuEngine
from pocketgs.splat.settings import StepSettings
from pocketgs.splat.timing import NoTimer, PassTimer
from pocketgs.system.process import peak_rss_mb
from pocketgs.training.recipes import recipe_named
from pocketgs.training.train import train

SIZES = ((10_000, 504, 378), (50_000, 504, 378), (50_000, 1008, 756), (170_000, 504, 378), (170_000, 1008, 756))
PASSES = ("cull", "project", "sort", "bin", "rasterize", "loss", "rasterize backward", "project backward", "Adam")
"""Names of the passes in the engine's timer."""

ITERATIONS = 100


def main(
    capture: Annotated[Path | None, tyro.conf.Positional] = None,
    threads: int | None = None,
    steps: int = 30,
    reading: CaptureOptions = CaptureOptions(),  # noqa: B008 - a frozen dataclass
) -> None:
    """Print the table.

    Args:
        capture: A capture to train on first; random scenes if none is given.
        threads: CPU threads, or None for all cores.
        steps: Steps timed for each row; medians are printed.
        reading: How to read the capture.
    """
    CpuEngine(threads).prepare()
    if steps < 1:
        raise SystemExit(f"steps: found {steps}, expected at least 1")
    table = Table("one step, in ms", *PASSES, "step")
    pairs = Table(
        "splat-pixel pairs", "visited (M)", "contribute", "forward (G/s)", "backward (G/s)", "bwd / fwd", "buffers (MB)"
    )
    for name, gaussians, frames in scenes(capture, reading):
        add_rows(table, pairs, name, gaussians, frames, threads, steps)
    console = Console(width=180)
    console.print(table, pairs, f"peak resident memory {peak_rss_mb():.0f} MB", sep="\n")


def scenes(capture: Path | None, reading: CaptureOptions) -> Iterator[tuple[str, Gaussians, Sequence[Frame]]]:
    """Scenes to time, with their names and views."""
    if capture is None:
        for count, width, height in SIZES:
            yield "random", *random_scene(count, width, height)
    else:
        opened = read_capture(capture, reading)
        if opened.points is None:
            raise SystemExit(f"{capture}: has no point cloud, expected one with points to start from")
        most = len(opened.points)
        scene = train(opened, prior="none", iterations=ITERATIONS, evaluate_every=0, max_gaussians=most).scene
        yield opened.name, scene, opened.train


def random_scene(count: int, width: int, height: int) -> tuple[Gaussians, Sequence[Frame]]:
    """Layers of small, differently shaped Gaussians that fill a view, about as dense as a trained scene."""
    rng = np.random.default_rng(0)
    means = rng.uniform([-1.4, -1.05, 0.0], [1.4, 1.05, 1.0], (count, 3))
    size = 0.9 * np.sqrt(2.8 * 2.1 / count)
    gaussians = Gaussians(
        means,
        np.log(size * np.exp(rng.normal(-0.3, 0.5, (count, 3)))),
        rng.normal(size=(count, 4)),
        rng.normal(0.0, 2.0, count),
        rng.normal(size=(count, 1, 3)),
    )
    pose = look_at(np.array([0.0, 0.0, -2.5]), np.zeros(3), np.array([0.0, -1.0, 0.0]))
    camera = Camera(width, height, width, width, width / 2, height / 2, pose)
    image = rng.integers(0, 256, (height, width, 3)).astype(np.uint8)
    return gaussians, [Frame("random", camera, image)]


def settings_without_motion() -> StepSettings:
    """The default recipe's settings with rates of 0, so that every step is the same."""
    recipe = recipe_named("pocketgs")
    return StepSettings(recipe.rates.scaled(0.0), recipe.loss, recipe.adam)


def add_rows(
    table: Table,
    pairs: Table,
    name: str,
    gaussians: Gaussians,
    frames: Sequence[Frame],
    threads: int | None,
    steps: int,
) -> None:
    """Time one scene and add a row to each table."""
    engine = CpuEngine(threads)
    engine.set_views(frames)
    engine.upload(gaussians)
    settings = settings_without_motion()
    for view in range(min(len(frames), 3)):
        engine.step(view, settings)
    engine.timer = PassTimer()
    milliseconds = engine.timer.milliseconds
    for step in range(steps):
        started = time.perf_counter()
        engine.step(step % len(frames), settings)
        milliseconds["step"].append(1e3 * (time.perf_counter() - started))
    engine.timer = NoTimer()
    median = {stage: float(np.median(values)) for stage, values in milliseconds.items()}
    visited, contributing = np.mean([count_pairs(engine, frame.camera) for frame in frames[:5]], axis=0)
    scene = f"{name}, {len(gaussians):,} Gaussians, {frames[0].camera.width}x{frames[0].camera.height}"
    table.add_row(scene, *(f"{median[stage]:.2f}" for stage in (*PASSES, "step")))
    pairs.add_row(
        scene,
        f"{visited / 1e6:.1f}",
        f"{contributing / visited:.0%}",
        f"{visited / median['rasterize'] / 1e6:.2f}",
        f"{visited / median['rasterize backward'] / 1e6:.2f}",
        f"{median['rasterize backward'] / median['rasterize']:.2f}",
        f"{sum(engine.memory().values()) / 1e6:.0f}",
    )


if __name__ == "__main__":
    tyro.cli(main, config=(tyro.conf.OmitArgPrefixes,))
