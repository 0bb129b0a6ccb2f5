"""Neighbourhoods of points on the GPU and on the CPU: milliseconds, and how much of the tree a point looks at.

    python bench/webgpu_neighbours.py --points 50000

Each cloud is a curved surface; the second has a twentieth of its points on a shell 100 times as far away.
"""

from __future__ import annotations

from functools import partial

import numpy as np
import tyro
from rich.console import Console
from rich.table import Table

from medians import median_milliseconds
from pocketgs.gpu.adapters import choose_adapter
from pocketgs.scene.morton import morton_order
from pocketgs.seeding.cpu import CpuSearch
from pocketgs.seeding.webgpu.layout import LEAF, MOST_NEIGHBOURS, numbers_of
from pocketgs.seeding.webgpu.search import WebGpuSearch

SAMPLE = 300
"""Points whose way through the tree is counted."""


def main(points: int = 50_000, repeats: int = 5, gpu: str | None = None) -> None:
    """Print the table.

    Args:
        points: Of each cloud.
        repeats: Searches timed; medians are printed.
        gpu: Part of the GPU's name; by default the best.
    """
    console = Console(width=120, highlight=False)
    adapter = choose_adapter(gpu)
    kind = " (software)" if adapter.is_software else ""
    console.print(f"{adapter.name}{kind}, {points:,} points, medians of {repeats}")
    cpu, search = CpuSearch(), WebGpuSearch(gpu)
    table = Table("cloud", "CPU ms", "GPU ms", "nearest points", "surfaces", "boxes tested", "points looked at")
    for name, positions in (("surface", surface(points)), ("with a shell", with_a_shell(points))):
        search.around(positions[:100])  # compiles what is needed
        on_cpu, on_gpu = (median_milliseconds(partial(one.around, positions), repeats) for one in (cpu, search))
        with search.executor.timed() as times:
            search.around(positions)
        passes = [f"{times.medians()[name]:.1f}" for name in ("nearest points", "surfaces")]
        boxes, looked_at = work(search, positions[morton_order(positions)])
        table.add_row(name, f"{on_cpu:.0f}", f"{on_gpu:.0f}", *passes, f"{boxes:.0f}", f"{looked_at:.0f}")
    console.print(table)


def surface(count: int) -> np.ndarray:
    """(N, 3) points of a wave, of side 2."""
    x, y = np.random.default_rng(0).uniform(-1, 1, (2, count))
    return np.stack([x, y, 0.2 * np.sin(4 * x) * np.cos(3 * y)], axis=1)


def with_a_shell(count: int) -> np.ndarray:
    """The same, but for some points that are far away in all directions."""
    positions, outwards = surface(count), np.random.default_rng(1).normal(size=(count // 20, 3))
    positions[: count // 20] = 100 * outwards / np.linalg.norm(outwards, axis=1, keepdims=True)
    return positions


def work(search: WebGpuSearch, positions: np.ndarray) -> tuple[float, float]:
    """Boxes that a point is compared with, and points that it looks at, on average: as `nearest_points.wgsl` does."""
    search.submit(positions)
    leaves = numbers_of(len(positions))["leaves"]
    boxes = search.executor.read("boxes", np.float32, 16 * leaves).reshape(-1, 2, 4)[:, :, :3]
    placed = search.executor.read("positions", np.float32, positions.size).reshape(-1, 3)
    search.executor.release()
    sample = np.random.default_rng(2).choice(len(placed), min(SAMPLE, len(placed)), replace=False)
    return tuple(np.mean([_work_of(int(point), placed, boxes, leaves) for point in sample], axis=0))


def _work_of(point: int, placed: np.ndarray, boxes: np.ndarray, leaves: int) -> tuple[int, int]:
    own, nearest, tested, looked_at = placed[point], np.full(MOST_NEIGHBOURS, np.inf), 0, 0
    number = leaves + point // LEAF
    waiting = [number]
    while waiting:
        box = waiting.pop()
        tested += 1
        gap = np.maximum(np.maximum(boxes[box, 0] - own, own - boxes[box, 1]), 0)
        if gap @ gap < nearest[-1] and box < leaves:
            waiting += [2 * box + 1, 2 * box]
        elif gap @ gap < nearest[-1]:
            others = placed[(box - leaves) * LEAF :][:LEAF]
            looked_at += len(others)
            squares = np.concatenate([nearest, np.sum((others - own) ** 2, axis=1)])
            nearest = np.sort(squares)[:MOST_NEIGHBOURS]
        if not waiting and number > 1:
            waiting.append(number ^ 1)
            number //= 2
    return tested, looked_at


if __name__ == "__main__":
    tyro.cli(main)
