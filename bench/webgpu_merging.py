"""Merging candidates to points on the GPU and on the CPU: milliseconds.

    python bench/webgpu_merging.py --candidates 500000 --points 100000

The candidates lie on a curved surface, with footprints and details that vary.
"""

from __future__ import annotations

from functools import partial

import numpy as np
import tyro
from rich.console import Console
from rich.table import Table

from medians import median_milliseconds
from pocketgs.gpu.adapters import choose_adapter
from pocketgs.prior.cloud.cpu.merger import CpuMerger
from pocketgs.prior.cloud.merge import Candidates
from pocketgs.prior.cloud.webgpu.merger import WebGpuMerger


def main(candidates: int = 500_000, points: int = 100_000, repeats: int = 3, gpu: str | None = None) -> None:
    """Print the tables.

    Args:
        candidates: Number of candidates.
        points: Number of points to merge them to, at most.
        repeats: Runs timed; medians are printed.
        gpu: Part of the GPU's name; by default the best.
    """
    console = Console(width=120, highlight=False)
    adapter = choose_adapter(gpu)
    kind = " (software)" if adapter.is_software else ""
    given = wave(candidates)
    console.print(f"{adapter.name}{kind}, {candidates:,} candidates, at most {points:,} points")
    on_gpu, on_cpu = WebGpuMerger(gpu), CpuMerger()
    with on_gpu.executor.timed() as times:
        found = on_gpu.merged(given, points)
    cpu, gpu_time = (median_milliseconds(partial(one.merged, given, points), repeats) for one in (on_cpu, on_gpu))
    table = Table("points", "CPU ms", "GPU ms", "CPU / GPU")
    table.add_row(f"{len(found):,}", f"{cpu:.0f}", f"{gpu_time:.0f}", f"{cpu / gpu_time:.2f}")
    console.print(table)
    passes = Table("pass", "GPU ms")
    for name, milliseconds in times.medians().items():
        passes.add_row(name, f"{milliseconds:.2f}")
    console.print(passes)


def wave(count: int) -> Candidates:
    """Pixels of a wave, in no order."""
    rng = np.random.default_rng(0)
    x, y = rng.uniform(-1, 1, (2, count))
    positions = np.stack([x, y, 0.2 * np.sin(4 * x) * np.cos(3 * y)], axis=1)
    directions = np.tile([0.0, 0.0, 1.0], (count, 1))
    footprints = 2 / np.sqrt(count) * np.exp(rng.normal(0, 0.3, count))
    details = rng.uniform(0, 0.2, count)
    return Candidates(positions, np.clip(positions, 0, 1), directions, footprints, details, rng.uniform(0.1, 1, count))


if __name__ == "__main__":
    tyro.cli(main)
