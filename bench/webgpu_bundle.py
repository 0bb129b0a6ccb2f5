"""The normal equations of bundle adjustment on the GPU and on the CPU: milliseconds per step.

    python bench/webgpu_bundle.py --cameras 128 --observations 90000

Cameras look inwards from a ring; each point is seen by some that are neighbours. The defaults have the size of a room
of 128 photographs.
"""

from __future__ import annotations

from functools import partial

import numpy as np
import tyro
from rich.console import Console
from rich.table import Table

from medians import median_milliseconds
from pocketgs.geometry.camera import Camera, look_at
from pocketgs.gpu.adapters import choose_adapter
from pocketgs.gpu.device import shared_device
from pocketgs.gpu.executor import Executor
from pocketgs.prior.bundle.cpu.equations import CpuEquations
from pocketgs.prior.bundle.equations import NormalEquations
from pocketgs.prior.bundle.problem import by_point, first_estimate
from pocketgs.prior.bundle.reprojection import Estimate, Sightings
from pocketgs.prior.bundle.webgpu.equations import WebGpuEquations
from pocketgs.prior.bundle.webgpu.passes import REDUCE, STEP, describe_equations
from pocketgs.prior.bundle.webgpu.problem import meetings_of
from pocketgs.prior.features.observations import Observations

HUBER, DAMPING = 1.0, 1e-4


def main(
    cameras: int = 128, observations: int = 90_000, views: int = 10, repeats: int = 5, gpu: str | None = None
) -> None:
    """Print the tables.

    Args:
        cameras: Number of cameras.
        observations: Number of observations.
        views: Observations per point.
        repeats: Steps timed; medians are printed.
        gpu: Part of the GPU's name; by default the best.
    """
    console = Console(width=120, highlight=False)
    adapter = choose_adapter(gpu)
    kind = " (software)" if adapter.is_software else ""
    sightings, estimate = ring(cameras, observations // views, views)
    met = len(meetings_of(sightings).observations)
    console.print(f"{adapter.name}{kind}, {cameras} cameras, {len(sightings.frame):,} observations, {met:,} meetings")
    executor = Executor(shared_device(adapter), describe_equations())
    on_gpu, on_cpu = WebGpuEquations(executor, sightings, HUBER), CpuEquations(sightings, HUBER)
    table = Table("", "CPU ms", "GPU ms", "CPU / GPU")
    camera_step = 1e-4 * np.random.default_rng(1).normal(size=6 * cameras)
    on_gpu.reduced(estimate, DAMPING)  # compiles what is needed
    for name, work in ((REDUCE, _reduce), (STEP, partial(_step, camera_step))):
        cpu, gpu_time = (median_milliseconds(partial(work, one, estimate), repeats) for one in (on_cpu, on_gpu))
        table.add_row(name, f"{cpu:.1f}", f"{gpu_time:.1f}", f"{cpu / gpu_time:.2f}")
    console.print(table)
    with executor.timed() as times:
        on_gpu.reduced(estimate, DAMPING)
        on_gpu.point_steps(camera_step)
    passes = Table("pass", "GPU ms")
    for name, milliseconds in times.medians().items():
        passes.add_row(name, f"{milliseconds:.2f}")
    console.print(passes)


def ring(cameras: int, points: int, views: int) -> tuple[Sightings, Estimate]:
    """A problem whose points are seen by neighbouring cameras of a ring."""
    rng = np.random.default_rng(0)
    turns = 2 * np.pi * np.arange(cameras) / cameras
    down = np.array([0.0, -1.0, 0.0])
    posed = [
        Camera(
            800, 600, 700.0, 700.0, 400.0, 300.0, look_at(4 * np.array([np.cos(t), 0.0, np.sin(t)]), np.zeros(3), down)
        )
        for t in turns.tolist()
    ]
    frame = (rng.integers(0, cameras, points)[:, None] + np.arange(views)).ravel() % cameras
    point = np.repeat(np.arange(points), views)
    pixels = rng.uniform([0, 0], [800, 600], (len(frame), 2))
    seen = Observations(frame.astype(np.int32), point.astype(np.int32), pixels)
    positions = rng.uniform(-1, 1, (points, 3))
    return by_point(posed, points, seen, np.arange(len(frame))), first_estimate(posed, positions)


def _reduce(equations: NormalEquations, estimate: Estimate) -> None:
    equations.reduced(estimate, DAMPING)


def _step(camera_step: np.ndarray, equations: NormalEquations, estimate: Estimate) -> None:
    equations.point_steps(camera_step)


if __name__ == "__main__":
    tyro.cli(main)
