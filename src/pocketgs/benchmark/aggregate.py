"""Aggregation of results over seeds: means, spreads, and differences between methods.

A spread is half the range, (largest − smallest) / 2: with three seeds, a standard deviation would say little more.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from pocketgs.benchmark.methods import METHODS
from pocketgs.benchmark.published import Published
from pocketgs.benchmark.results import CellResult

BASELINE = "pocketgs"
"""The method that the others are compared with."""

STAGES = {
    "start": ("startup", "capture", "planning", "compilation", "upload"),
    "poses": ("keyframes", "poses"),
    "depth": ("depth",),
    "fusion, seeds": ("fusion", "coverage", "seeding"),
    "points": ("points",),
    "training": ("training",),
    "evaluation": ("evaluation",),
    "writing": ("writing",),
}
"""The stages of a run, short ones merged: names in the report, and the names in `run.json` that they stand for."""


@dataclass(frozen=True)
class Figure:
    """A figure of a run.

    Attributes:
        name: as in a table's head, with its unit.
        decimals: to show.
        of: reads it from a result; None if the run does not have it.
        quoted: reads it from the figures that the source reports; None if it reports none.
    """

    name: str
    decimals: int
    of: Callable[[CellResult], float | None]
    quoted: Callable[[Published], float | None] = lambda source: None


@dataclass(frozen=True)
class Mean:
    """Mean of one figure over seeds.

    Attributes:
        value: the mean.
        spread: half the range.
        count: number of seeds.
    """

    value: float
    spread: float
    count: int


@dataclass(frozen=True)
class Row:
    """A method on a capture.

    Attributes:
        capture: its name.
        method: its name.
        results: of the runs that succeeded, by seed.
        seeds: maximum number of seeds of any method on this capture.
    """

    capture: str
    method: str
    results: tuple[CellResult, ...]
    seeds: int

    def mean(self, of: Callable[[CellResult], float | None]) -> Mean | None:
        """Mean of a figure over the runs that have it, or None if none does."""
        return mean_of(of(result) for result in self.results)


def mean_of(values: Iterable[float | None]) -> Mean | None:
    """Mean and spread of the values that are not None, or None if there are none."""
    found = [value for value in values if value is not None]
    if not found:
        return None
    return Mean(math.fsum(found) / len(found), (max(found) - min(found)) / 2, len(found))


def number(value: Any) -> float | None:
    """The value if it is a finite number, else None: files may contain null or NaN."""
    if isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value):
        return float(value)
    return None


def in_run(name: str) -> Callable[[CellResult], float | None]:
    """A function that reads the number of this name from a result's `run.json`."""
    return lambda result: number(result.run.get(name))


def stage_seconds(result: CellResult) -> dict[str, float]:
    """Seconds by stage, merged as in `STAGES`; other stages keep their own names."""
    group = {name: stage for stage, names in STAGES.items() for name in names}
    seconds: dict[str, float] = {}
    for name, value in (result.run.get("seconds") or {}).items():
        found = number(value)
        if name != "total" and found is not None:
            stage = group.get(name, name)
            seconds[stage] = seconds.get(stage, 0.0) + found
    return seconds


def stages_of(results: Iterable[CellResult]) -> list[str]:
    """All stages of some runs, in order; those that are not in `STAGES` last."""
    found = {stage for result in results for stage in stage_seconds(result)}
    return [stage for stage in STAGES if stage in found] + sorted(found - STAGES.keys())


def gpu_megabytes(result: CellResult) -> float | None:
    """MB of GPU memory of the engine, or None if it used no GPU."""
    if result.run.get("engine") != "webgpu":
        return None
    held = [number(value) for value in (result.run.get("engine_bytes") or {}).values()]
    return sum(value for value in held if value is not None) / 1e6


def scene_megabytes(suffix: str) -> Callable[[CellResult], float | None]:
    """A function that reads the size in MB of a result's scene in a file format."""

    def size(result: CellResult) -> float | None:
        found = number(result.scene_bytes.get(suffix))
        return None if found is None else found / 1e6

    return size


PSNR = Figure("PSNR (dB)", 2, in_run("psnr"), lambda source: source.psnr)
SSIM = Figure("SSIM", 3, in_run("ssim"), lambda source: source.ssim)
CC_PSNR = Figure("colour-corrected PSNR (dB)", 2, in_run("cc_psnr"))
FLIP = Figure("FLIP", 3, in_run("flip"))
LPIPS = Figure("LPIPS", 3, in_run("lpips"), lambda source: source.lpips)
SECONDS = Figure("time (s)", 1, lambda result: number(result.wall_seconds), lambda source: source.seconds)
FIGURES = (
    PSNR,
    CC_PSNR,
    SSIM,
    FLIP,
    LPIPS,
    SECONDS,
    Figure("peak memory (MB)", 0, in_run("peak_rss_mb")),
    Figure("GPU memory (MB)", 0, gpu_megabytes),
    Figure("Gaussians", 0, in_run("gaussians"), lambda source: source.gaussians),
    Figure(".ply (MB)", 1, scene_megabytes("ply")),
    Figure(".spz (MB)", 1, scene_megabytes("spz")),
)


def method_order(method: str) -> tuple[int, str]:
    """Sort key: methods in the order of `METHODS`, then others by name."""
    names = list(METHODS)
    return (names.index(method) if method in names else len(names), method)


def in_order(results: Iterable[CellResult]) -> list[CellResult]:
    """Results sorted by capture, method and seed."""
    return sorted(results, key=lambda it: (it.cell.capture, method_order(it.cell.method), it.cell.seed))


def captures_of(results: Iterable[CellResult]) -> list[str]:
    """Sorted names of the captures."""
    return sorted({result.cell.capture for result in results})


def methods_of(results: Iterable[CellResult]) -> list[str]:
    """Names of the methods, in table order."""
    return sorted({result.cell.method for result in results}, key=method_order)


def rows_of(results: Sequence[CellResult], capture: str) -> list[Row]:
    """A row per method with results on a capture, even if all its runs failed."""
    here = in_order(result for result in results if result.cell.capture == capture)
    seeds = len({result.cell.seed for result in here})
    return [
        Row(capture, method, tuple(it for it in here if it.cell.method == method and it.error is None), seeds)
        for method in methods_of(here)
    ]


def difference(row: Row, other: Row, figure: Figure) -> Mean | None:
    """Mean difference of a figure, `row` minus `other`, over common seeds; None without common seeds."""
    return mean_of(mine - theirs for mine, theirs in _pairs(row, other, figure.of))


def ratio(row: Row, other: Row, figure: Figure) -> Mean | None:
    """Mean ratio of a figure, `row` over `other`, over common seeds; None without common seeds."""
    return mean_of(mine / theirs for mine, theirs in _pairs(row, other, figure.of) if theirs > 0)


def _pairs(row: Row, other: Row, of: Callable[[CellResult], float | None]) -> list[tuple[float, float]]:
    by_seed = {result.cell.seed: of(result) for result in other.results}
    pairs = ((of(result), by_seed.get(result.cell.seed)) for result in row.results)
    return [(mine, theirs) for mine, theirs in pairs if mine is not None and theirs is not None]
