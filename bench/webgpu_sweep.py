"""Depth by the WebGPU passes beside the CPU's kernels: time by pass, their ratio, bytes moved at least.

    python bench/webgpu_sweep.py                        # views of the demo's room in two sizes
    python bench/webgpu_sweep.py --width 730 --height 547 --hypotheses 192      # the largest sweep of a run

Both sides work on the same views. Passes on the GPU are timed by timestamps, or each submitted alone and waited for.
"""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np
import tyro
from rich.console import Console
from rich.table import Table

from pocketgs.capture.capture import Frame
from pocketgs.capture.synthetic import true_capture
from pocketgs.gpu.adapters import choose_adapter
from pocketgs.gpu.device import shared_device
from pocketgs.prior.cloud.fuse import views_of
from pocketgs.prior.depth.confidence import confidence_map
from pocketgs.prior.depth.consistency import Agreement, SweptViews
from pocketgs.prior.depth.cpu.consistency import compare_depths
from pocketgs.prior.depth.cpu.matching_cost import matching_costs
from pocketgs.prior.depth.cpu.semi_global import EIGHT_PATHS, FOUR_PATHS, aggregate, winners
from pocketgs.prior.depth.cpu.stereo import as_source_views, grey_levels, smoothed
from pocketgs.prior.depth.depth_range import DepthRange
from pocketgs.prior.depth.sweep import DepthMap, SweepSettings, step_of
from pocketgs.prior.depth.webgpu.stereo import WebGpuStereo
from webgpu_roofline import measure_roofline

TOLERANCE, LEAST = 0.005, 0.4
"""Of depths that agree, and the least confidence outside holes."""

Result = TypeVar("Result")

SIZES = ((120, 90), (240, 180))

SWEPT = ("squares", "matching costs", "aggregate", "winners", "smooth")
COMPARED = ("agreement", "confidence", "count believed", "fill holes")
NAMES = {name: f"{name}, one view" for name in COMPARED}
"""The passes of a sweep, and those that compare a view's depths with all others'."""


@dataclass
class Milliseconds:
    """Times of passes over several sweeps."""

    values: dict[str, list[float]] = field(default_factory=lambda: defaultdict(list))

    def measure(self, name: str, work: Callable[[], Result]) -> Result:
        """Time a function."""
        started = time.perf_counter()
        result = work()
        self.values[name].append(1e3 * (time.perf_counter() - started))
        return result

    def median(self, name: str) -> float:
        """Of a pass."""
        return float(np.median(self.values[name]))


def main(
    width: int | None = None,
    height: int | None = None,
    hypotheses: int = 128,
    paths: int = 8,
    repeats: int = 5,
    gpu: str | None = None,
) -> None:
    """Print the tables.

    Args:
        width: Of the views; by default several sizes.
        height: Of the views.
        hypotheses: Depths that the sweep tests.
        paths: Of semi-global matching, 4 or 8.
        repeats: Sweeps timed; medians are printed.
        gpu: Part of the GPU's name; by default the best.
    """
    console = Console(width=150, highlight=False)
    adapter = choose_adapter(gpu)
    roofline = measure_roofline(shared_device(adapter), adapter.is_software)
    kind = " (software)" if adapter.is_software else ""
    console.print(f"{adapter.name}{kind}: copies at {roofline.bytes_per_second / 1e9:,.1f} GB/s; medians of {repeats}")
    settings = SweepSettings(paths=paths)
    for size in [(width, height)] if width and height else SIZES:
        frames = true_capture(*size, frames=6, points=10).train
        search = DepthRange(1.2, 12.0, hypotheses)
        stereo = WebGpuStereo(gpu)
        on_gpu = gpu_times(stereo, frames, search, settings, repeats)
        on_cpu = cpu_times(frames, search, settings, repeats)
        moved = bytes_moved(size, len(frames) - 1, hypotheses, paths)
        title = f"{size[0]}x{size[1]}, {hypotheses} hypotheses, {len(frames) - 1} source views, {paths} paths"
        table = Table("pass", "CPU (ms)", "WebGPU (ms)", "CPU / WebGPU", "MB at least", "share of a copy", title=title)
        for name in (*SWEPT, *COMPARED):
            seconds, share = on_gpu.median(name) / 1e3, moved[name] / roofline.bytes_per_second
            cpu = f"{on_cpu.median(name):.2f}" if name in on_cpu.values else "-"
            ratio = f"{on_cpu.median(name) / on_gpu.median(name):.2f}" if name in on_cpu.values else "-"
            megabytes = f"{moved[name] / 1e6:.1f}"
            table.add_row(
                NAMES.get(name, name), cpu, f"{1e3 * seconds:.2f}", ratio, megabytes, f"{share / seconds:.1%}"
            )
        sums = [sum(map(times.median, times.values)) for times in (on_cpu, on_gpu)]
        table.add_row("all", f"{sums[0]:.2f}", f"{sums[1]:.2f}", f"{sums[0] / sums[1]:.2f}", "", "")
        stereo.sweep(frames[0], frames[1:], search, settings)
        held = sum(stereo.sweeping.sizes().values()) / 1e6
        console.print(table, f"{held:.1f} MB of buffers in a sweep", sep="\n")


def gpu_times(
    stereo: WebGpuStereo, frames: Sequence[Frame], search: DepthRange, settings: SweepSettings, repeats: int
) -> Milliseconds:
    """Times of the passes, all paths together."""
    stereo.sweep(frames[0], frames[1:], search, settings)
    times = Milliseconds()
    for _ in range(repeats):
        with stereo.sweeping.timed() as measured:
            stereo.sweep(frames[0], frames[1:], search, settings)
        for name in SWEPT:
            together = [sum(found) for each, found in measured.milliseconds.items() if each.startswith(name)]
            times.values[name].append(sum(together))
        views = exact_views(frames)
        with stereo.comparing.timed() as measured:
            list(stereo.compare(views, list(np.ones_like(views.depths)), TOLERANCE, LEAST))
        for name in COMPARED:
            times.values[name] += measured.milliseconds[name]
    return times


def cpu_times(frames: Sequence[Frame], search: DepthRange, settings: SweepSettings, repeats: int) -> Milliseconds:
    """Times of the kernels, of which the first call loads machine code."""
    sweep_in_passes(frames, search, settings, Milliseconds())
    times = Milliseconds()
    for _ in range(repeats):
        sweep_in_passes(frames, search, settings, times)
    return times


def sweep_in_passes(frames: Sequence[Frame], search: DepthRange, settings: SweepSettings, times: Milliseconds) -> None:
    """Sweep the first frame on the CPU."""
    paths = EIGHT_PATHS if settings.paths == 8 else FOUR_PATHS
    inverse_depths = search.inverse_depths
    views = exact_views(frames)
    view, among = grey_levels(frames[0]), as_source_views(frames[0].camera, frames[1:])
    steps = settings.small_step, settings.large_step
    costs = times.measure("matching costs", lambda: matching_costs(view, among, inverse_depths))
    total = times.measure("aggregate", lambda: aggregate(costs, view, paths, *steps))
    depth = times.measure("winners", lambda: winners(total, inverse_depths, len(paths))[0])
    agreement = Agreement(*times.measure("agreement", lambda: compare_depths(views, 0, TOLERANCE)))
    # All of it: the CPU has no passes.
    margin = np.ones_like(views.depths[0])
    times.measure("confidence", lambda: confidence_map(agreement, views.depths[0], margin, LEAST))
    times.measure("smooth", lambda: smoothed(depth, step_of(inverse_depths)))


def exact_views(frames: Sequence[Frame]) -> SweptViews:
    """The true depth maps of the frames."""
    maps = [DepthMap(frame.depth, np.ones(frame.depth.shape), 1e-3) for frame in frames if frame.depth is not None]
    return views_of(frames, maps)


def bytes_moved(size: tuple[int, int], sources: int, hypotheses: int, paths: int) -> dict[str, int]:
    """Bytes that each pass has to read and write, if repeated reads hit a cache."""
    pixels = size[0] * size[1]
    volume = pixels * hypotheses
    return {
        "squares": 8 * sources * pixels,
        "matching costs": (4 + 4 * sources) * pixels + volume,
        # Costs are read, sums read and written; the first path reads none.
        "aggregate": 5 * paths * volume - 2 * volume,
        "winners": 2 * volume + 12 * pixels,
        "smooth": 8 * pixels,
        "agreement": (sources + 1) * 4 * pixels + 8 * pixels,
        "confidence": 12 * pixels,
        "count believed": 8 * pixels,
        "fill holes": 20 * pixels,
    }


if __name__ == "__main__":
    tyro.cli(main)
