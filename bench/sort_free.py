"""Drawing sorted and without sorting: time per frame, and how much frames of a slow path change.

    python bench/sort_free.py --sizes 50000 200000
    python bench/sort_free.py --teacher SCENE --scene SORT_FREE --capture CAPTURE

The first draws random scenes, frame after frame in turn, and prints medians and their ratio. The second draws a trained
scene and what was distilled from it along a path through the capture's first cameras, in steps of a two-thousandth of
the way from one to the next. Motion alone changes an image by nearly the same from one step to the next: what remains
in the change of the change are jumps, where splats change places in the sorted order, or cross the cut of 1/255.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Literal

import numpy as np
import tyro
from rich.console import Console
from rich.table import Table

from cpu_step import random_scene
from pocketgs.capture.options import CaptureOptions
from pocketgs.cli.capture_options import read_capture
from pocketgs.cli.scene_file import in_world_of
from pocketgs.geometry.camera import Camera
from pocketgs.geometry.camera_path import path
from pocketgs.scene.gaussians import Gaussians
from pocketgs.scene.morton import morton_order
from pocketgs.sort_free.drawing import drawing_of
from pocketgs.sort_free.file import read_sort_free
from pocketgs.sort_free.renderer import SortFreeRenderer
from pocketgs.sort_free.scene import SortFreeScene, sort_free
from pocketgs.splat.choose_engine import create_engine
from pocketgs.splat.engine import EngineOptions
from pocketgs.splat.rasterizer import Rasterizer

Draw = Callable[[Camera], np.ndarray]
CAMERAS, STEPS_BETWEEN_VIEWS = 4, 2000


def main(
    sizes: tuple[int, ...] = (50_000, 200_000),
    width: int = 504,
    height: int = 378,
    rounds: int = 10,
    engine: Literal["cpu", "webgpu"] = "cpu",
    threads: int | None = None,
    teacher: Path | None = None,
    scene: Path | None = None,
    capture: Path | None = None,
    frames: int = 60,
    reading: CaptureOptions = CaptureOptions(),  # noqa: B008 - a frozen dataclass
) -> None:
    """Print the tables.

    Args:
        sizes: Gaussians of the random scenes.
        width: Of random scenes' images, in pixels.
        height: Of random scenes' images, in pixels.
        rounds: Frames timed for each row; medians are printed.
        engine: That draws.
        threads: CPU threads, or None for all cores.
        teacher: A trained scene, a .ply.
        scene: What was distilled from it.
        capture: The capture of both.
        frames: Of the path.
        reading: How to read the capture.
    """
    over, free, options = Rasterizer(engine, threads), SortFreeRenderer(engine, threads), EngineOptions(engine, threads)
    console = Console(width=150)
    if teacher is not None and scene is not None and capture is not None:
        gaussians, distilled = Gaussians.load(teacher), read_sort_free(scene)
        opened = in_world_of(teacher, read_capture(capture, reading))
        cameras = [frame.camera for frame in opened.train[:CAMERAS]]
        slow = path(cameras, len(cameras) * STEPS_BETWEEN_VIEWS)[:frames]
        ways = drawings(over, free, gaussians, distilled, options)
        console.print(times("trained", ways, slow[0], rounds), popping(ways, slow))
        return
    for count in sizes:
        gaussians, [frame] = random_scene(count, width, height)
        gaussians = gaussians.select(morton_order(gaussians.means))
        ways = drawings(over, free, gaussians, sort_free(gaussians, "visibility", 2.5), options)
        console.print(times("random", ways, frame.camera, rounds))


def drawings(
    over: Rasterizer, free: SortFreeRenderer, gaussians: Gaussians, scene: SortFreeScene, options: EngineOptions
) -> dict[str, Draw]:
    """Functions that draw an image, by name: whole images as the commands draw them, and the undivided sums."""
    channels = np.ones((len(scene), 4), np.float32)

    def drawn(renderer: Rasterizer, of: Gaussians) -> Draw:
        def draw(camera: Camera) -> np.ndarray:
            found = renderer.forward(of, camera, ("features",), features=channels).features
            assert found is not None
            return found

        return draw

    sorted_engine, sort_free_drawing = create_engine(options), drawing_of(scene, options)
    sorted_engine.upload(gaussians)
    return {
        "sorted": lambda camera: sorted_engine.render(camera).image,
        "sort-free": lambda camera: sort_free_drawing.render(camera).image,
        "sorted, 4 channels": drawn(over, scene.gaussians),
        "sum, 4 channels": drawn(free.rasterizer, scene.gaussians),
    }


def times(name: str, ways: dict[str, Draw], camera: Camera, rounds: int) -> Table:
    """Milliseconds of a frame, and ratios to the sorted one."""
    milliseconds: dict[str, list[float]] = {way: [] for way in ways}
    for _ in range(rounds + 1):
        for way, draw in ways.items():
            started = time.perf_counter()
            draw(camera)
            milliseconds[way].append(1e3 * (time.perf_counter() - started))
    medians = {way: float(np.median(found[1:])) for way, found in milliseconds.items()}
    table = Table(f"{name}, {camera.width}x{camera.height}: ms", *ways)
    table.add_row("frame", *(f"{found:.1f} ({found / medians['sorted']:.2f}x)" for found in medians.values()))
    return table


def popping(ways: dict[str, Draw], cameras: list[Camera]) -> Table:
    """Mean absolute change between neighbouring frames, and of that change."""
    table = Table("in 1/255", "change", "change of the change", "of a pixel in ten thousand")
    for way in ("sorted", "sort-free"):
        images = np.array([255.0 * np.clip(ways[way](camera), 0.0, 1.0) for camera in cameras])
        changes = np.abs(np.diff(images, axis=0))
        jumps = np.abs(np.diff(images, 2, axis=0))
        table.add_row(way, f"{changes.mean():.4f}", f"{jumps.mean():.4f}", f"{np.quantile(jumps, 0.9999):.2f}")
    return table


if __name__ == "__main__":
    tyro.cli(main, config=(tyro.conf.OmitArgPrefixes,))
