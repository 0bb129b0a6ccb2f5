"""A complete run: load a capture, train, evaluate, and write the result folder."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from pocketgs.capture.capture import Capture, Frame
from pocketgs.capture.listed import ListedCapture
from pocketgs.errors import PocketGSError
from pocketgs.files.plain_names import plain_names
from pocketgs.metrics.evaluation import Evaluation, Pair, evaluate
from pocketgs.prior.depth.stereo import Stereo
from pocketgs.prior.prior import PreparedCapture
from pocketgs.results import folder as result_folder
from pocketgs.results.cameras_file import write_cameras
from pocketgs.results.checkpoint import (
    CHECKPOINT,
    MAX_GAUSSIANS,
    SHRINK,
    UNFINISHED,
    read_checkpoint,
    read_size,
    write_checkpoint,
)
from pocketgs.results.claim import Claim
from pocketgs.results.memory_trace import MemoryTrace
from pocketgs.results.reporter import Reporter
from pocketgs.results.summary import summarise
from pocketgs.scene.gaussians import Gaussians
from pocketgs.splat.constants import SSIM_WINDOW
from pocketgs.splat.engine import Engine, Renderer, create_engine
from pocketgs.system import freed_memory
from pocketgs.system.interrupt import deferred_interrupt
from pocketgs.system.process import seconds_since_start
from pocketgs.system.stopwatch import Stopwatch
from pocketgs.training.open_ended import end_of
from pocketgs.training.options import SizedOptions, TrainingOptions
from pocketgs.training.planning.calibration import measure_speed, times_prior
from pocketgs.training.planning.effort import sized
from pocketgs.training.planning.machine import this_machine
from pocketgs.training.planning.plan import Plan, make_plan, plan_again, shrinking_warning
from pocketgs.training.preparation import devices_of, prepare
from pocketgs.training.progress import Progress
from pocketgs.training.result import Checkpoint, TrainingResult
from pocketgs.training.train import train
from pocketgs.training.validation import render_frame

SECONDS_BETWEEN_CHECKPOINTS = 60.0
MIN_TIME = 1e-3
"""Lower bound of the training time if the time budget is already used up."""


@dataclass(frozen=True)
class RunResult:
    """The result of a run.

    Attributes:
        folder: with the result's files.
        scene: the trained Gaussians.
        evaluation: of the held-out views, or None if there are none.
        summary: the content of `run.json`.
        transients: (h, w) bool for each training view, its cells that were left out, see
            `pocketgs.training.transients`; None if none were looked for.
    """

    folder: Path
    scene: Gaussians
    evaluation: Evaluation | None
    summary: dict[str, Any]
    transients: tuple[np.ndarray, ...] | None = None


def run(
    list_capture: Callable[[], ListedCapture],
    folder: Path,
    options: TrainingOptions,
    *,
    resume: bool = False,
    reporter: Reporter | None = None,
    source: str | None = None,
) -> RunResult:
    """Train on a capture and write the result to a folder; see `pocketgs.results.folder` for its files.

    Args:
        list_capture: lists the capture; its photographs are decoded after planning.
        folder: created if needed. An earlier result there is kept until the new one is complete.
        options: how to train.
        resume: continue from the checkpoint in the folder.
        reporter: receives progress.
        source: identifies the capture, see `pocketgs.files.manifest.source_of`.

    Raises:
        PocketGSError: the capture, an option or the folder cannot be used, or a budget is too small.
    """
    reporter = reporter or Reporter()

    def begin(stage: str) -> None:
        if stage not in stopwatch.seconds:
            freed_memory.give_back()
        reporter.on_stage(stage)

    stopwatch = Stopwatch(begin)
    stopwatch.seconds["startup"] = seconds_since_start()
    with result_folder.claimed_for_run(folder, source) as claim, MemoryTrace(lambda: stopwatch.current) as memory:
        return _run(list_capture, claim, options, resume, reporter, stopwatch, memory)


def _run(
    list_capture: Callable[[], ListedCapture],
    claim: Claim,
    options: TrainingOptions,
    resume: bool,
    reporter: Reporter,
    stopwatch: Stopwatch,
    memory: MemoryTrace,
) -> RunResult:
    folder = claim.folder
    engine = create_engine(options.engine_options)  # fails before the work starts if there is no such engine
    devices = devices_of(options)
    with stopwatch.stage("capture"):
        listed = list_capture()
    with stopwatch.stage("planning"):
        options = sized(options, listed.outline().training)
        size = read_size(folder) if resume else None
        plan = _plan(listed, options, engine, devices.stereo, size)
    if size is None and (warning := shrinking_warning(plan, options)):
        reporter.on_warning(warning)
    reporter.on_plan(plan)
    with stopwatch.stage("capture"):
        capture = listed.load(plan.shrink, plan.readers)
    reporter.on_capture(capture)
    check_comparable(capture.held_out)
    identity = _identity(capture, options, plan)
    checkpoint = read_checkpoint(folder, identity) if resume else None
    if checkpoint and checkpoint.iteration >= _end(checkpoint, options):
        found = f"{checkpoint.iteration} iterations are already done"
        raise PocketGSError(f"{folder}: {found}, expected --iterations to ask for more")
    saver = _CheckpointSaver(folder, identity, reporter.on_warning)

    def observe(progress: Progress) -> None:
        reporter.on_progress(progress)
        saver.observe(progress)

    planned = replace(options, max_gaussians=plan.gaussians)
    prepared = prepare(capture, planned, stopwatch, devices)
    if prepared.report:
        reporter.on_prior(prepared.report)
    reporter.on_prepared(prepared)
    seconds = _seconds_left(options, plan)
    if seconds is not None and seconds <= 0:
        reporter.on_warning("the time budget was used up before training began: the untrained scene is written")
    result = train(
        prepared,
        replace(planned, time_budget=None if seconds is None else max(seconds, MIN_TIME)),
        observer=observe,
        resume=checkpoint,
        stopwatch=stopwatch,
        opened_engine=engine,
    )
    with deferred_interrupt():
        return _publish(capture, prepared, claim, options, result, engine, identity, plan, stopwatch, memory)


def _end(checkpoint: Checkpoint, options: SizedOptions) -> int:
    """The iteration at which a resumed run ends at the latest."""
    decided = end_of(checkpoint.course, options.iterations) if options.open_ended and checkpoint.course else None
    return decided or options.iterations


def _plan(
    listed: ListedCapture, options: SizedOptions, engine: Engine, stereo: Stereo, size: tuple[int, int] | None
) -> Plan:
    """Plan the run; `size` is that of a run to resume, see `read_size`."""
    if options.time_budget is not None and options.prior == "colmap":
        raise PocketGSError("time budget: the time that COLMAP takes is unknown, expected another --prior or no budget")
    machine = this_machine(engine, stereo, options)
    if size is not None:
        return plan_again(listed, options, machine, *size)
    plan = make_plan(listed, options, machine)
    if options.time_budget is None:
        return plan
    speed = measure_speed(engine, stereo, machine.threads, times_prior(engine, options))
    return make_plan(listed, options, replace(machine, speed=speed, elapsed=seconds_since_start()))


def _seconds_left(options: SizedOptions, plan: Plan) -> float | None:
    """The rest of the time budget before evaluation and writing must start."""
    if options.time_budget is None:
        return None
    return options.time_budget - seconds_since_start() - (plan.reserve or 0.0)


class _CheckpointSaver:
    """Writes a checkpoint at intervals, so that a long run can be resumed after a crash.

    If a checkpoint cannot be written, for example because the disk is full, the run continues.
    """

    def __init__(self, folder: Path, identity: dict[str, Any], on_warning: Callable[[str], None]) -> None:
        self._folder, self._identity, self._on_warning = folder, identity, on_warning
        self._last = time.monotonic()

    def observe(self, progress: Progress) -> None:
        if time.monotonic() - self._last >= SECONDS_BETWEEN_CHECKPOINTS:
            self._last = time.monotonic()
            try:
                path = self._folder / UNFINISHED
                write_checkpoint(path, progress.checkpoint(), self._identity)
            except (PocketGSError, OSError) as error:
                self._on_warning(f"training continues without a checkpoint: {error}")


def _identity(capture: Capture, options: SizedOptions, plan: Plan) -> dict[str, Any]:
    """What must be equal between a checkpoint and the run that resumes from it."""
    return {
        "capture": capture.name,
        "protocol": capture.protocol,
        "training views": len(capture.train),
        "recipe": options.recipe,
        "seed": options.seed,
        "SH degree": options.sh_degree,
        "prior": options.prior,
        "bundle": options.bundle,
        "source views": options.source_views,
        "max keyframes": options.max_keyframes,
        "exposure": options.exposure,
        "max gaussians": options.max_gaussians,
        "strategy": options.strategy,
        SHRINK: plan.shrink,
        MAX_GAUSSIANS: plan.gaussians,
        "colours": options.colours,
        "transients": options.transients,
        # A run that trained as long as it paid may go on with a set length, but not the other way round.
        **({"open ended": True} if options.open_ended else {}),
    }


def check_comparable(held_out: Sequence[Frame]) -> None:
    """Check before the work starts that every held-out view can be compared with its photograph.

    Raises:
        PocketGSError: one of them cannot.
    """
    border = SSIM_WINDOW // 2
    for frame in held_out:
        width, height = frame.camera.width, frame.camera.height
        if min(width, height) < SSIM_WINDOW:
            expected = f"expected at least {SSIM_WINDOW} pixels a side, or --hold-out 0"
            raise PocketGSError(f"{frame.name}: a held-out view of {width}x{height} pixels, {expected}")
        if frame.mask is not None and not frame.mask[border:-border, border:-border].any():
            expected = f"expected unmasked pixels {border} or more inside the image, or --hold-out 0"
            raise PocketGSError(f"{frame.name}: the mask of a held-out view leaves nothing, {expected}")


def _publish(
    capture: Capture,
    prepared: PreparedCapture,
    claim: Claim,
    options: TrainingOptions,
    result: TrainingResult,
    engine: Engine,
    identity: dict[str, Any],
    plan: Plan,
    stopwatch: Stopwatch,
    memory: MemoryTrace,
) -> RunResult:
    """Evaluate the scene, at the poses that it was trained with, and publish the result."""
    refined = prepared.report is not None and prepared.report.poses_refined
    pictures = [f"{folder}/*" for folder in (result_folder.PICTURES, result_folder.TRANSIENTS)]
    with claim.publishing(result_folder.FILES, outdated=[*pictures, result_folder.COMPRESSED]) as staging:
        with stopwatch.stage("writing"):
            result.scene.save(staging / result_folder.SCENE)
            write_checkpoint(staging / CHECKPOINT, result.checkpoint, identity)
            if result.transients:
                result_folder.write_transients(staging, prepared.train, result.transients)
            write_cameras(staging / result_folder.CAMERAS, prepared.frames, refined, prepared.origin)
        with stopwatch.stage("evaluation"):
            (staging / result_folder.PICTURES).mkdir()
            evaluation = evaluate_held_out(engine, prepared, staging / result_folder.PICTURES)
        stopwatch.seconds["total"] = seconds_since_start()
        summary = summarise(
            capture, prepared.protocol, options, plan, result, evaluation, stopwatch.seconds, memory.samples
        )
        result_folder.write_json(staging / result_folder.RECORD, summary)
    (claim.folder / UNFINISHED).unlink(missing_ok=True)
    return RunResult(claim.folder, result.scene, evaluation, summary, result.transients)


def evaluate_held_out(renderer: Renderer, capture: Capture, pictures: Path | None = None) -> Evaluation | None:
    """Compare a scene with the held-out photographs; None if there are none.

    Args:
        renderer: holds the scene.
        capture: with the held-out frames and the background.
        pictures: an existing folder for side-by-side images, or None for no images.
    """
    if not capture.held_out:
        return None

    def pairs() -> Iterator[Pair]:
        names = plain_names(frame.name for frame in capture.held_out)
        for frame, name in zip(capture.held_out, names, strict=True):
            rendered = render_frame(renderer, frame, capture.background)
            if pictures:
                result_folder.write_side_by_side(pictures, name, frame.image, rendered)
            yield frame.name, rendered, (frame.image / np.float32(255.0)).astype(np.float32), frame.mask

    return evaluate(pairs())
