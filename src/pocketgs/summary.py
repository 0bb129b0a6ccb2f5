"""What a run was asked, what it took and how good it is: the content of `run.json`."""

from __future__ import annotations

import platform
from collections.abc import Sequence
from dataclasses import asdict
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from pocketgs.capture.capture import Capture
from pocketgs.evaluation import Evaluation
from pocketgs.gaussians import Gaussians
from pocketgs.memory_trace import MemorySample
from pocketgs.planning.plan import Plan
from pocketgs.record import RunRecord, peak_rss_mb
from pocketgs.training_options import TrainingOptions

DEPENDENCIES = ("numpy", "numba", "llvmlite", "opencv-python-headless", "scipy", "pillow", "wgpu")


def summarise(
    capture: Capture,
    protocol: str,
    options: TrainingOptions,
    plan: Plan,
    scene: Gaussians,
    evaluation: Evaluation | None,
    seconds: dict[str, float],
    memory: Sequence[MemorySample],
) -> dict[str, Any]:
    """The content of `run.json`."""
    record = scene.record
    assert record is not None
    return {
        "psnr": evaluation.psnr if evaluation else None,
        "ssim": evaluation.ssim if evaluation else None,
        "lpips": evaluation.lpips if evaluation else None,
        "lpips_note": evaluation.lpips_note if evaluation else None,
        "coverage": record.prior.coverage if record.prior else None,
        "keyframes": record.prior.keyframes if record.prior else None,
        "gaussians": record.gaussians,
        "iterations": record.iterations,
        "resumed_from": record.resumed_from,
        "interrupted": record.interrupted,
        "peak_rss_mb": peak_rss_mb(),
        "seconds": {name: round(value, 3) for name, value in seconds.items()},
        "protocol": protocol,
        "engine": record.engine,
        "device": record.device,
        "engine_bytes": record.engine_bytes,
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
        "plan": _expected_and_actual(plan, record, seconds["total"]),
        "prior": asdict(record.prior) if record.prior else None,
        "images": [asdict(image) for image in evaluation.images] if evaluation else [],
        "progress": [asdict(sample) for sample in record.losses],
        "memory": [asdict(sample) for sample in memory],
        "versions": versions(),
    }


def _expected_and_actual(plan: Plan, record: RunRecord, seconds: float) -> dict[str, Any]:
    """The plan, with what the run took beside what was expected of it; buffers of a GPU count as the device's."""
    on_device = 0 if record.engine == "cpu" else sum(record.engine_bytes.values())
    return {
        **asdict(plan),
        "actual": {
            "gaussians": record.gaussians,
            "peak_rss_mb": peak_rss_mb(),
            "device_mb": on_device / 1e6,
            "iterations": record.iterations,
            "seconds": round(seconds, 3),
        },
    }


def versions() -> dict[str, str]:
    """Versions of this package, of Python, of the system and of what the numbers depend on."""
    found = {"python": platform.python_version(), "system": platform.platform()}
    for package in ("pocketgs", *DEPENDENCIES):
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "unknown"
    return found
