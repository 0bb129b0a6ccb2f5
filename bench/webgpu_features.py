"""Features by the WebGPU passes beside OpenCV's SIFT: time by pass, ratios, and how many features and matches agree.

python bench/webgpu_features.py                             # views of the demo's room
python bench/webgpu_features.py --width 1280 --height 960   # the largest photographs that features are found in

Both sides work on the same views. Passes on the GPU are timed by timestamps, or each submitted alone and waited for.
"""

from __future__ import annotations

from collections import defaultdict
from functools import partial

import numpy as np
import tyro
from rich.console import Console
from rich.table import Table
from scipy.spatial import cKDTree

from medians import median_milliseconds
from pocketgs.capture.synthetic import true_capture
from pocketgs.gpu.adapters import choose_adapter
from pocketgs.gpu.timing import CLEAR, PassTimes
from pocketgs.prior.features.cpu.finder import CpuFinder
from pocketgs.prior.features.features import Features
from pocketgs.prior.features.finder import FeatureFinder
from pocketgs.prior.features.webgpu.finder import WebGpuFinder

NEAR = 0.01
"""Pixels within which two features are the same."""


def main(width: int = 320, height: int = 240, most: int = 2000, repeats: int = 5, gpu: str | None = None) -> None:
    """Print the tables.

    Args:
        width: Of the views.
        height: Of the views.
        most: Features per view.
        repeats: Views and pairs timed; medians are printed.
        gpu: Part of the GPU's name; by default the best.
    """
    console = Console(width=120, highlight=False)
    adapter = choose_adapter(gpu)
    kind = " (software)" if adapter.is_software else ""
    console.print(f"{adapter.name}{kind}, {width}x{height}, at most {most} features, medians of {repeats}")
    frames = true_capture(width, height, frames=8, points=1).train[:2]
    finders: tuple[FeatureFinder, WebGpuFinder] = CpuFinder(), WebGpuFinder(gpu)
    table = Table("", "features", "ms per view", "matches", "ms per pair")
    found: list[list[Features]] = []
    for finder in finders:
        features = [finder.detect(frame, most) for frame in frames]  # compiles what is needed
        pairs = finder.match(*features)
        detecting = median_milliseconds(partial(finder.detect, frames[0], most), repeats)
        matching = median_milliseconds(partial(finder.match, *features), repeats)
        table.add_row(
            finder.name, f"{len(features[0].pixels):,}", f"{detecting:.1f}", f"{len(pairs):,}", f"{matching:.1f}"
        )
        found.append(features)
    console.print(table)
    same = np.mean(cKDTree(found[1][0].pixels).query(found[0][0].pixels)[0] < NEAR)
    console.print(f"{same:.2%} of the CPU's features are the GPU's too, within {NEAR} pixels")
    with finders[1].finding.timed() as finding:
        finders[1].detect(frames[0], most)
    with finders[1].matching.timed() as matching_times:
        finders[1].match(*found[1])
    passes = Table("pass", "ms, over all octaves")
    for name, milliseconds in (*_sums(finding).items(), *_sums(matching_times).items()):
        passes.add_row(name, f"{milliseconds:.2f}")
    console.print(passes)


def _sums(times: PassTimes) -> dict[str, float]:
    sums: dict[str, float] = defaultdict(float)
    for name, milliseconds in times.milliseconds.items():
        if name != CLEAR:
            sums[name] += float(np.sum(milliseconds))
    return dict(sums)


if __name__ == "__main__":
    tyro.cli(main)
