"""A complete run: load a capture, train, evaluate, and write the result folder."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from pocketgs.capture.capture import Capture
from pocketgs.capture.listed import ListedCapture
from pocketgs.errors import PocketGSError
from pocketgs.metrics.evaluation import Evaluation
from pocketgs.prior.depth.stereo import Stereo
from pocketgs.prior.prior import PreparedCapture
from pocketgs.results import folder as result_folder
from pocketgs.results.cameras_file import write_cameras
from pocketgs.results.checkpoint import (
    CHECKPOINT,
    UNFINISHED,
    CheckpointSaver,
    read_checkpoint,
    read_size,
    write_checkpoint,
)
from pocketgs.results.claim import Claim
from pocketgs.results.held_out import check_comparable, evaluate_held_out
from pocketgs.results.identity import identity_of
from pocketgs.results.memory_trace import MemoryTrace
from pocketgs.results.reporter import Reporter
from pocketgs.results.summary import summarise
from pocketgs.scene.gaussians import Gaussians
from pocketgs.splat.choose_engine import create_engine
from pocketgs.splat.engine import Engine
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
from pocketgs.training.result import Checkpoint, TrainingResult
from pocketgs.training.train import train

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
        stopped: whether Ctrl-C was pressed, during training or later.
    """

    folder: Path
    scene: Gaussians
    evaluation: Evaluation | None
    summary: dict[str, Any]
    transients: tuple[np.ndarray, ...] | None = None
    stopped: bool = False


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


@dataclass(frozen=True)
class _Session:
    """What a run works with, once it is planned.

    Attributes:
        claim: of the result folder.
        options: with sizes, as the user asked for them.
        plan: what budgets allow.
        engine: to train and render on.
        stopwatch, memory: what the run takes.
        reporter: receives progress.
    """

    claim: Claim
    options: SizedOptions
    plan: Plan
    engine: Engine
    stopwatch: Stopwatch
    memory: MemoryTrace
    reporter: Reporter


def _run(
    list_capture: Callable[[], ListedCapture],
    claim: Claim,
    options: TrainingOptions,
    resume: bool,
    reporter: Reporter,
    stopwatch: Stopwatch,
    memory: MemoryTrace,
) -> RunResult:
    engine = create_engine(options.engine_options)  # fails before the work starts if there is no such engine
    devices = devices_of(options)
    with stopwatch.stage("capture"):
        listed = list_capture()
    with stopwatch.stage("planning"):
        asked = sized(options, listed.outline().training)
        size = read_size(claim.folder) if resume else None
        plan = _plan(listed, asked, engine, devices.stereo, size)
    if size is None and (warning := shrinking_warning(plan, asked)):
        reporter.on_warning(warning)
    reporter.on_plan(plan)
    with stopwatch.stage("capture"):
        capture = listed.load(plan.shrink, plan.readers)
    reporter.on_capture(capture)
    check_comparable(capture.held_out)
    session = _Session(claim, asked, plan, engine, stopwatch, memory, reporter)
    identity = identity_of(capture, asked, plan)
    checkpoint = _checkpoint(claim.folder, identity, asked) if resume else None
    prepared = prepare(capture, replace(asked, max_gaussians=plan.gaussians), stopwatch, devices)
    if prepared.report:
        reporter.on_prior(prepared.report)
    reporter.on_prepared(prepared)
    result = _trained(session, prepared, identity, checkpoint)
    with deferred_interrupt() as interrupt:
        published = _publish(session, capture, prepared, identity, result)
    return replace(published, stopped=result.interrupted or interrupt.requested)


def _checkpoint(folder: Path, identity: dict[str, Any], options: SizedOptions) -> Checkpoint:
    """The checkpoint to resume from.

    Raises:
        PocketGSError: there is none of this run, or it has no iterations left.
    """
    checkpoint = read_checkpoint(folder, identity)
    if checkpoint.iteration >= _end(checkpoint, options):
        found = f"{checkpoint.iteration} iterations are already done"
        raise PocketGSError(f"{folder}: {found}, expected --iterations to ask for more")
    return checkpoint


def _trained(
    session: _Session, prepared: PreparedCapture, identity: dict[str, Any], checkpoint: Checkpoint | None
) -> TrainingResult:
    """Train for what is left of the time budget, with a checkpoint now and then."""
    saver = CheckpointSaver(session.claim.folder, identity, session.reporter.on_warning)
    seconds = _seconds_left(session.options, session.plan)
    if seconds is not None and seconds <= 0:
        written = "the scene of the checkpoint is written again" if checkpoint else "the untrained scene is written"
        session.reporter.on_warning(f"the time budget was used up before training began: {written}")
    return train(
        prepared,
        replace(
            session.options,
            max_gaussians=session.plan.gaussians,
            time_budget=None if seconds is None else max(seconds, MIN_TIME),
            expected_iterations=session.plan.iterations,
        ),
        observer=session.reporter.on_progress,
        saver=saver.observe,
        resume=checkpoint,
        stopwatch=session.stopwatch,
        opened_engine=session.engine,
    )


def _end(checkpoint: Checkpoint, options: SizedOptions) -> int:
    """The iteration at which a resumed run ends at the latest."""
    decided = end_of(checkpoint.history, options.iterations) if options.open_ended and checkpoint.history else None
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


def _publish(
    session: _Session, capture: Capture, prepared: PreparedCapture, identity: dict[str, Any], result: TrainingResult
) -> RunResult:
    """Evaluate the scene, at the poses that it was trained with, and publish the result.

    The scene is written first: whatever fails after that, it is kept.
    """
    claim, stopwatch = session.claim, session.stopwatch
    transients = result.checkpoint.transients
    refined = prepared.report is not None and prepared.report.poses_refined
    pictures = [f"{folder}/*" for folder in (result_folder.PICTURES, result_folder.TRANSIENTS)]
    outdated = [*pictures, result_folder.COMPRESSED]
    with claim.publishing(result_folder.FILES, outdated, precious=result_folder.SCENE) as staging:
        with stopwatch.stage("writing"):
            result.scene.save(staging / result_folder.SCENE)
            write_checkpoint(staging / CHECKPOINT, result.checkpoint, identity)
            if transients:
                result_folder.write_transients(staging, prepared.train, transients)
            write_cameras(staging / result_folder.CAMERAS, prepared.frames, refined, prepared.origin)
        with stopwatch.stage("evaluation"):
            (staging / result_folder.PICTURES).mkdir()
            evaluation = evaluate_held_out(session.engine, prepared, staging / result_folder.PICTURES)
        stopwatch.seconds["total"] = seconds_since_start()
        summary = summarise(
            capture,
            prepared.protocol,
            session.options,
            session.plan,
            result,
            evaluation,
            stopwatch.seconds,
            session.memory.samples,
        )
        result_folder.write_json(staging / result_folder.RECORD, summary)
    (claim.folder / UNFINISHED).unlink(missing_ok=True)
    return RunResult(claim.folder, result.scene, evaluation, summary, transients)
