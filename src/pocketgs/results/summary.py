"""The content of `run.json`: options, resources used and quality of a run."""

from __future__ import annotations

import platform
from collections.abc import Sequence
from dataclasses import asdict
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from pocketgs.capture.capture import Capture
from pocketgs.metrics.evaluation import MEANS, Evaluation
from pocketgs.prior.report import PriorReport
from pocketgs.results.memory_trace import MemorySample
from pocketgs.splat.colours import transforms_of
from pocketgs.system.process import peak_rss_mb
from pocketgs.training.options import TrainingOptions
from pocketgs.training.planning.plan import Plan
from pocketgs.training.result import TrainingResult
from pocketgs.training.transients import is_left_out

DEPENDENCIES = (
    "numpy",
    "numba",
    "llvmlite",
    "opencv-python-headless",
    "scipy",
    "pillow",
    "av",
    "wgpu",
    "flip-evaluator",
)


def summarise(
    capture: Capture,
    protocol: str,
    options: TrainingOptions,
    plan: Plan,
    result: TrainingResult,
    evaluation: Evaluation | None,
    seconds: dict[str, float],
    memory: Sequence[MemorySample],
) -> dict[str, Any]:
    """Make the content of `run.json`."""
    history = result.checkpoint.history
    return {
        **(evaluation.means if evaluation else dict.fromkeys(MEANS)),
        "lpips_note": evaluation.lpips_note if evaluation else None,
        "contradicted_views": _contradicted_views(result, evaluation),
        "colours": _learned_colours(result),
        "transients": _transients(result),
        "dropout": result.dropout,
        "coverage": result.prior.coverage if result.prior else None,
        "keyframes": result.prior.keyframes if result.prior else None,
        "gaussians": len(result.scene),
        "iterations": result.iterations,
        "resumed_from": result.resumed_from,
        "interrupted": result.interrupted,
        "peak_rss_mb": peak_rss_mb(),
        "seconds": {name: round(value, 3) for name, value in seconds.items()},
        "protocol": protocol,
        "engine": result.engine,
        "device": result.device,
        "engine_bytes": result.engine_bytes,
        "capture": {
            "name": capture.name,
            "format": capture.format,
            "training_views": len(capture.train),
            "held_out_views": len(capture.held_out),
            "points": len(capture.points) if capture.points else 0,
            "image_bytes": capture.image_bytes,
            "background": capture.background,
            "metric": capture.metric,
            "origin": capture.origin,
            "warnings": capture.warnings,
        },
        "options": asdict(options),
        "plan": _expected_and_actual(plan, result, seconds["total"]),
        "prior": _prior(result.prior) if result.prior else None,
        "images": [asdict(image) for image in evaluation.images] if evaluation else [],
        "progress": [asdict(sample) for sample in result.losses],
        "validation": asdict(history) if history else None,
        "memory": [asdict(sample) for sample in memory],
        "versions": versions(),
    }


def _contradicted_views(result: TrainingResult, evaluation: Evaluation | None) -> dict[str, Any] | None:
    """The held-out views whose given poses are contradicted, and the means without them; None if there are none.

    Their errors may be those of their poses, not of the scene.
    """
    if evaluation is None or result.prior is None:
        return None
    contradicted = result.prior.poses.contradicted
    names = [image.name for image in evaluation.images if image.name in contradicted]
    others = evaluation.without(names)
    return {"names": names, "means_without": others.means if others else None} if names else None


def _learned_colours(result: TrainingResult) -> dict[str, float] | None:
    """By what factors the photographs' colour transforms multiply red, green and blue; None if none was learned."""
    table = result.checkpoint.state.colours
    if table is None:
        return None
    gains = transforms_of(table)[:, range(3), range(3)]
    return {"least_gain": float(gains.min()), "largest_gain": float(gains.max())}


def _prior(report: PriorReport) -> dict[str, Any]:
    """The report; of the photographs' gains the least and the largest, if exposure was compensated."""
    gains = None if report.gains is None else [float(report.gains.min()), float(report.gains.max())]
    return {**asdict(report), "gains": gains}


def _transients(result: TrainingResult) -> dict[str, Any] | None:
    """In how many training photographs transients were masked, the mean share of a photograph that this is, and the
    names of those that were left out whole.
    """
    transients = result.checkpoint.transients
    if transients is None:
        return None
    kept = [cells for cells in transients if not is_left_out(cells)]
    shares = [float(cells.mean()) for cells in kept]
    return {
        "photographs": sum(share > 0 for share in shares),
        "share": sum(shares) / max(len(shares), 1),
        "left_out": list(result.left_out),
    }


def _expected_and_actual(plan: Plan, result: TrainingResult, seconds: float) -> dict[str, Any]:
    """The plan's predictions beside the actual figures; a GPU's buffers count as the device's."""
    on_device = 0 if result.engine == "cpu" else sum(result.engine_bytes.values())
    return {
        **asdict(plan),
        "actual": {
            "gaussians": len(result.scene),
            "peak_rss_mb": peak_rss_mb(),
            "device_mb": on_device / 1e6,
            "iterations": result.iterations,
            "seconds": round(seconds, 3),
        },
    }


def versions() -> dict[str, str]:
    """Versions of this package, of Python, of the system and of the dependencies that affect results."""
    found = {"python": platform.python_version(), "system": platform.platform()}
    for package in ("pocketgs", *DEPENDENCIES):
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "unknown"
    return found
