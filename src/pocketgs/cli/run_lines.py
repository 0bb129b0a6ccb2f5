"""Lines of text about a run: its stages, capture, plan, prior and progress."""

from __future__ import annotations

from pocketgs.capture.capture import Capture
from pocketgs.prior.report import PriorReport
from pocketgs.system.process import peak_rss_mb
from pocketgs.training.planning.plan import Plan
from pocketgs.training.progress import Progress

STAGES = {
    "frames": "choosing frames",
    "features": "finding features",
    "matching": "matching features",
    "verification": "checking matches",
    "mapping": "finding poses",
    "capture": "reading the capture",
    "keyframes": "choosing keyframes",
    "poses": "matching features and refining poses",
    "depth": "computing depth (the first run compiles its kernels)",
    "fusion": "fusing depths into a cloud",
    "coverage": "filling holes of the cloud",
    "planning": "planning",
    "points": "choosing points to start from",
    "seeding": "seeding Gaussians",
    "compilation": "loading kernels (the first run compiles them: up to a minute)",
    "upload": "preparing the engine",
    "compressing": "pruning, fine-tuning and rounding",
    "writing": "writing the result",
    "visibility": "measuring how much of each Gaussian is seen (the first run compiles kernels)",
    "evaluation": "evaluating the held-out views",
}
SECONDS_BEFORE_GUESSING = 2.0
"""Time before a stage's remaining time is estimated."""


def capture_lines(capture: Capture) -> list[str]:
    """Describe a capture."""
    points = f"{len(capture.points):,} points" if capture.points else "no points of its own"
    views = f"{len(capture.train)} training views, {len(capture.held_out)} held out"
    masked = sum(frame.mask is not None for frame in capture.frames)
    if masked:
        views += f", masks for {masked} of {len(capture.frames)}"
    units = "metres" if capture.metric else "scene units"
    return [
        f"{capture.name} ({capture.format}): {views}, {points}, {units}, {capture.image_bytes / 1e6:.0f} MB of images",
        f"protocol: {capture.protocol}",
    ]


def count_line(stage: str, done: int, of: int, seconds: float) -> str:
    """Progress of a stage, with its estimated remaining time."""
    line = f"{STAGES.get(stage, stage)}: {done}/{of}"
    if of / 10 < done < of and seconds >= SECONDS_BEFORE_GUESSING:
        line += f", about {max(1, round(seconds / done * (of - done)))} s left"
    return line


def plan_line(plan: Plan) -> str:
    """One line about a plan."""
    parts = [f"photographs up to {plan.width}x{plan.height}", f"at most {plan.gaussians:,} Gaussians"]
    parts.append(f"up to {plan.peak_rss_mb:.0f} MB of memory")
    if plan.device_mb:
        parts.append(f"{plan.device_mb:.0f} MB on the GPU")
    if plan.seconds is not None:
        parts.append(f"about {plan.iterations} iterations in {plan.seconds:.0f} s")
    return "plan: " + ", ".join(parts)


def prior_line(report: PriorReport) -> str:
    """One line about the result of the geometry prior."""
    parts = [f"{report.keyframes} keyframes of {len(report.decisions)} frames"]
    if report.rmse is not None and report.rmse_given is not None:
        parts.append(f"{report.sparse_points:,} sparse points")
        parts.append(_poses(report, report.rmse_given, report.rmse))
    if report.gains is not None:
        parts.append(f"exposure compensated, gains {report.gains.min():.0%} to {report.gains.max():.0%}")
    parts.append(f"cloud of {report.points:,} points")
    if report.coverage is not None:
        known = f" ({report.coverage_known:.1%} by known depths)"
        parts.append(f"covers {report.coverage:.1%} of the training pixels{known}")
    return "prior: " + ", ".join(parts)


def _poses(report: PriorReport, rmse_given: float, rmse: float) -> str:
    """What became of the given poses, with their reprojection errors in pixels."""
    if report.poses.convention and rmse == rmse_given:
        return f"poses read as the photographs fit them (reprojection {rmse:.2f} px)"
    if report.poses_refined:
        return f"poses refined (reprojection {rmse_given:.2f} -> {rmse:.2f} px)"
    return f"poses as given (reprojection {rmse:.2f} px)"


def progress_line(progress: Progress) -> str:
    """One line about the progress of a run."""
    rate = progress.iteration_rate
    parts = [
        f"iteration {progress.iteration}/{progress.iterations}",
        f"loss {progress.loss:.4f}",
        f"{rate:.1f} it/s",
        f"{progress.seconds_left:.0f} s left",
        f"{progress.gaussians:,} Gaussians",
        f"{peak_rss_mb():.0f} MB",
    ]
    if progress.gain_per_minute is not None:
        parts.insert(4, f"validation {progress.gain_per_minute:+.2f} dB/min")
    if progress.held_out_psnr is not None:
        parts.insert(2, f"held-out PSNR {progress.held_out_psnr:.2f} dB")
    return "  ".join(parts)
