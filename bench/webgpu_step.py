"""One training step of the WebGPU engine: time by pass, pairs per second, shares of what the device can do, memory.

    python bench/webgpu_step.py                             # random scenes of several sizes
    python bench/webgpu_step.py --small --replay both       # small ones, and what a replay cache changes
    python bench/webgpu_step.py ../data/fern --images images_8     # a capture, after 100 iterations

Passes are timed by timestamps, one compute pass each; without timestamps, each is submitted alone and waited for.
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from statistics import median
from typing import Annotated, Any, Literal

import tyro
from rich.console import Console

from cpu_step import random_scene, settings_without_motion
from pocketgs.capture import Frame
from pocketgs.capture.options import CaptureOptions
from pocketgs.cli.capture_options import read_capture
from pocketgs.gpu.adapters import TIMESTAMPS, choose_adapter
from pocketgs.gpu.device import shared_device
from pocketgs.gpu.timing import milliseconds_to_wait
from pocketgs.scene.gaussians import Gaussians
from pocketgs.splat.engine import Accumulation, EngineOptions, Precision, Replay
from pocketgs.splat.webgpu.engine import WebGpuEngine
from pocketgs.training.options import TrainingOptions
from pocketgs.training.preparation import prepare
from pocketgs.training.train import train
from webgpu_roofline import measure_roofline
from webgpu_tables import (
    CHOICES,
    Measurement,
    memory_table,
    pairs_table,
    passes_table,
    ratios_table,
    steps_table,
)
from webgpu_work import Work, count_work

SIZES = ((50_000, 504, 378), (50_000, 1008, 756), (200_000, 1008, 756), (1_000_000, 1920, 1080))
SMALL_SIZES = ((2_000, 128, 96), (10_000, 252, 189))

COUNTED_VIEWS = 5

WARM_UP_SECONDS = 1.0
"""GPUs lower their clocks while they have nothing to do, and take a while to raise them."""

Scene = tuple[Gaussians, Sequence[Frame]]


def main(
    capture: Annotated[Path | None, tyro.conf.Positional] = None,
    gpu: str | None = None,
    precision: Precision | Literal["both"] = "f32",
    replay: Replay | Literal["both"] = "recompute",
    accumulation: Accumulation | Literal["both"] = "ordered",
    steps: int = 30,
    iterations: int = 100,
    small: bool = False,
    max_memory: int = 8000,
    reading: CaptureOptions = CaptureOptions(),  # noqa: B008 - a frozen dataclass
) -> None:
    """Print the tables.

    Args:
        capture: A capture to train on first; random scenes if none is given.
        gpu: Part of the GPU's name; by default the best.
        precision: Of projected splats, or both.
        replay: Whether the backward pass recomputes the forward pass or reads a cache, or both ways.
        accumulation: How tiles' gradients are summed, or both ways.
        steps: Number of steps timed, with and without timing of passes.
        iterations: How long to train on the capture.
        small: Small random scenes, for a quick run.
        max_memory: Megabytes of GPU memory that the engine may take.
        reading: How to read the capture.
    """
    console = Console(width=180, highlight=False)
    adapter = choose_adapter(gpu)
    roofline = measure_roofline(shared_device(adapter), adapter.is_software)
    console.print(
        f"{adapter.name}, {adapter.backend}, {adapter.driver}{' (software)' if adapter.is_software else ''}: "
        f"copies at {roofline.bytes_per_second / 1e9:,.1f} GB/s, {roofline.flops_per_second / 1e9:,.0f} GFLOP/s",
        f"passes timed by {'timestamps' if TIMESTAMPS in adapter.features else 'waiting for each'}; "
        f"medians of {steps} steps",
        sep="\n",
    )
    options = EngineOptions("webgpu", gpu=gpu, max_memory=max_memory)
    variants = list(_variants(options, {"precision": precision, "replay": replay, "accumulation": accumulation}))
    for scene in [scene_of(capture, reading, iterations, options)] if capture else random_scenes(small):
        gaussians, frames = scene
        camera = frames[0].camera
        console.rule(f"{len(gaussians):,} Gaussians, {camera.width} x {camera.height}, views: {len(frames)}")
        work = work_of(scene, options)
        measurements = [measure(scene, variant, work, steps, console) for variant in variants]
        for measurement in measurements:
            console.print(passes_table(measurement, roofline))
        console.print(steps_table(measurements), pairs_table(measurements, roofline), sep="\n")
        if len(measurements) > 1:
            console.print(ratios_table(measurements))
        console.print(memory_table(measurements))


def _variants(options: EngineOptions, asked: dict[str, str]) -> Iterator[EngineOptions]:
    """Every combination of the requested options."""
    ways = [CHOICES[name] if value == "both" else (value,) for name, value in asked.items()]
    for combination in itertools.product(*ways):
        chosen: dict[str, Any] = dict(zip(asked, combination, strict=True))
        yield replace(options, **chosen)


def random_scenes(small: bool) -> Iterator[Scene]:
    """The scenes of `bench/cpu_step.py`."""
    for count, width, height in SMALL_SIZES if small else SIZES:
        yield random_scene(count, width, height)


def scene_of(path: Path, reading: CaptureOptions, iterations: int, options: EngineOptions) -> Scene:
    """A scene trained on a capture, with its training views."""
    training = TrainingOptions(
        iterations=iterations,
        evaluate_every=0,
        max_gaussians=1_000_000,
        engine="webgpu",
        gpu=options.gpu,
        max_memory=options.max_memory,
    )
    prepared = prepare(read_capture(path, reading), training)
    return train(prepared, training).scene, prepared.train


def work_of(scene: Scene, options: EngineOptions) -> Work:
    """Count the work of a step on the scene."""
    gaussians, frames = scene
    engine = WebGpuEngine(options)
    engine.set_views(frames)
    engine.upload(gaussians)
    return count_work(engine, frames[:COUNTED_VIEWS], settings_without_motion())


def measure(scene: Scene, options: EngineOptions, work: Work, steps: int, console: Console) -> Measurement:
    """Time steps on a scene."""
    gaussians, frames = scene
    engine = WebGpuEngine(options)
    engine.prepare()
    engine.set_views(frames)
    engine.upload(gaussians)
    started = time.perf_counter()
    for view in itertools.cycle(range(len(frames))):
        engine.step(view, settings_without_motion())
        if view == len(frames) - 1 and time.perf_counter() - started > WARM_UP_SECONDS:
            break
    engine.loss()
    started = time.perf_counter()
    for step in range(steps):
        engine.step(step % len(frames), settings_without_motion())
    engine.loss()
    milliseconds = 1e3 * (time.perf_counter() - started) / steps
    with engine.executor.timed() as passes:
        for step in range(steps):
            engine.step(step % len(frames), settings_without_motion())
        engine.loss()
    if not engine.executor.has_timestamps:
        device = engine.executor.device
        waiting = median(milliseconds_to_wait(device, lambda encoder: None) for _ in range(20))
        console.print(f"waiting for nothing takes {waiting:.3f} ms, included in every pass")
    return Measurement(options, passes, milliseconds, engine.memory(), work)


if __name__ == "__main__":
    tyro.cli(main, config=(tyro.conf.OmitArgPrefixes,))
