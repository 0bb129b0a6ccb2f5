"""Time series recorded by runs: quality and memory."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from pocketgs.benchmark.aggregate import number, rows_of
from pocketgs.benchmark.results import CellResult
from pocketgs.results.memory_trace import MemorySample


@dataclass(frozen=True)
class CurvePoint:
    """One evaluation on the held-out views during training.

    Attributes:
        iteration: iterations done.
        seconds: since the command began, without evaluations.
        psnr: mean over the held-out views, in dB.
    """

    iteration: int
    seconds: float
    psnr: float


Curve = list[CurvePoint]
Trace = list[MemorySample]


def curves(results: Sequence[CellResult], capture: str) -> dict[str, list[Curve]]:
    """The curves of a capture's runs by method, one per seed; runs without a curve are left out."""
    by_method = {row.method: list(filter(None, map(_curve, row.results))) for row in rows_of(results, capture)}
    return {method: found for method, found in by_method.items() if found}


def _curve(result: CellResult) -> Curve:
    points = []
    for sample in result.run.get("progress") or []:
        iteration, seconds, psnr = (number(sample.get(name)) for name in ("iteration", "elapsed", "held_out_psnr"))
        if iteration is not None and seconds is not None and psnr is not None:
            points.append(CurvePoint(int(iteration), seconds, psnr))
    return points


def mean_curve(seeds: Sequence[Curve]) -> Curve:
    """Mean over seeds, of time and of PSNR, at the iterations at which all were evaluated."""
    by_iteration = [{point.iteration: point for point in curve} for curve in seeds]
    shared = sorted(set.intersection(*(set(points) for points in by_iteration)))
    means = []
    for iteration in shared:
        points = [found[iteration] for found in by_iteration]
        seconds, psnr = (
            sum(values) / len(points) for values in zip(*((it.seconds, it.psnr) for it in points), strict=True)
        )
        means.append(CurvePoint(iteration, seconds, psnr))
    return means


def traces(results: Sequence[CellResult], capture: str) -> dict[str, Trace]:
    """Memory over time of the first run of each method that recorded it."""
    found: dict[str, Trace] = {}
    for row in rows_of(results, capture):
        for trace in filter(None, map(_trace, row.results)):
            found.setdefault(row.method, trace)
    return found


def _trace(result: CellResult) -> Trace:
    samples = []
    for sample in result.run.get("memory") or []:
        seconds, megabytes = number(sample.get("seconds")), number(sample.get("rss_mb"))
        if seconds is not None and megabytes is not None:
            samples.append(MemorySample(seconds, str(sample.get("stage", "?")), megabytes))
    return samples
