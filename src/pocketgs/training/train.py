"""Training a splat: preparation, the first Gaussians, the engine, and the loop."""

from __future__ import annotations

import time
from dataclasses import replace

from pocketgs.capture.capture import Capture
from pocketgs.errors import PocketGSError
from pocketgs.prior.prior import PreparedCapture
from pocketgs.prior.report import PriorReport
from pocketgs.scene.gaussians import Gaussians
from pocketgs.scene.morton import morton_order
from pocketgs.scene.point_cloud import PointCloud
from pocketgs.seeding.devices import create_search, with_room
from pocketgs.seeding.seeds import SEEDINGS
from pocketgs.splat.choose_engine import chosen_engine, create_engine
from pocketgs.splat.engine import Engine
from pocketgs.system.interrupt import deferred_interrupt
from pocketgs.system.process import peak_rss_mb
from pocketgs.system.stopwatch import Stopwatch
from pocketgs.training.loop import Loop
from pocketgs.training.options import SizedOptions, TrainingOptions
from pocketgs.training.planning.effort import sized
from pocketgs.training.preparation import at_most, prepare
from pocketgs.training.progress import Observer
from pocketgs.training.recipes import recipe_named
from pocketgs.training.result import Checkpoint, TrainingResult
from pocketgs.training.run_setup import set_up
from pocketgs.training.transients import Transients


def train(
    capture: Capture,
    options: TrainingOptions | None = None,
    *,
    observer: Observer | None = None,
    saver: Observer | None = None,
    resume: Checkpoint | None = None,
    stopwatch: Stopwatch | None = None,
    opened_engine: Engine | None = None,
    **changes: object,
) -> TrainingResult:
    """Train a splat.

    The scene is in the world of the refined poses, which are those of the capture that `prepare` returns.

    Example:
        >>> result = train(open_capture("fern", images="images_8"), iterations=500)
        >>> result.scene.save("fern.ply")

    Ctrl-C ends training after the current step and returns the scene; before the first step it raises KeyboardInterrupt
    as usual.

    Args:
        capture: to train on; it is prepared first unless it comes from `prepare`.
        options: None for the defaults.
        observer: called after every iteration; its time does not count, since it may pause the run.
        saver: called after every iteration too; its time counts, like that of the steps.
        resume: checkpoint of an earlier run with the same capture and options.
        stopwatch: times the stages; None for a new one.
        opened_engine: from `create_engine`, to train on; None to create one.
        **changes: single options by name, which override those in `options`.

    Raises:
        PocketGSError: an option or the capture cannot be used.
    """
    started = time.monotonic()
    options = replace(options or TrainingOptions(), **changes)  # type: ignore[arg-type]
    options = sized(options, [(frame.camera.width, frame.camera.height) for frame in capture.train])
    stopwatch = stopwatch or Stopwatch()
    prepared = capture if isinstance(capture, PreparedCapture) else prepare(capture, options, stopwatch)
    if prepared.points is None:
        raise PocketGSError(f"{prepared.path}: no points to start from, expected what `prepare` gives")
    with stopwatch.stage("seeding"):
        # A capture may have been prepared for more Gaussians, or for another strategy.
        points = at_most(prepared.points, options.most_at_start, options.seed)
        start, warnings = (resume.gaussians, ()) if resume else _first_gaussians(points, options)
    with stopwatch.stage("compilation"):
        engine = opened_engine or create_engine(options.engine_options)
        engine.prepare()
    transients = _transients(prepared, options, resume)
    with stopwatch.stage("upload"):
        _upload(engine, prepared, start, transients, resume)
    seconds = None if options.time_budget is None else options.time_budget - (time.monotonic() - started)
    setup = set_up(prepared, points, options, seconds, resume)
    loop = Loop(prepared, options, setup, transients, engine, stopwatch, resume.iteration if resume else 0)
    with deferred_interrupt() as interrupt:  # until the last step has been copied from the engine
        loop.run(observer, saver, interrupt)
        checkpoint = loop.checkpoint()
    if loop.interrupted and loop.iteration == 0:
        raise KeyboardInterrupt
    return TrainingResult(
        checkpoint=checkpoint,
        engine=engine.name,
        device=engine.device,
        recipe=setup.recipe.name,
        strategy=setup.strategy.name,
        resumed_from=resume.iteration if resume else None,
        interrupted=loop.interrupted,
        seconds=dict(stopwatch.seconds),
        peak_rss_mb=peak_rss_mb(),
        engine_bytes=engine.memory(),
        losses=loop.samples,
        prior=_with_warnings(prepared.report, warnings),
        left_out=transients.left_out if transients else (),
        dropout=setup.dropout,
    )


def _first_gaussians(points: PointCloud, options: SizedOptions) -> tuple[Gaussians, tuple[str, ...]]:
    """Seeds at points, in Morton order: neighbours form clusters that most views can skip; and warnings."""
    recipe = recipe_named(options.recipe)
    device = create_search(chosen_engine(options.engine_options), options.gpu, options.max_memory)
    search, warnings = with_room(device, len(points))
    degree = recipe.degree_for(options.sh_degree)
    start = SEEDINGS[options.seeds](points, recipe.opacity, degree, recipe.seed_size, search)
    return start.select(morton_order(start.means)), warnings


def _transients(capture: PreparedCapture, options: SizedOptions, resume: Checkpoint | None) -> Transients | None:
    """The run's masking of things that move; None if it is off."""
    if options.transients == "keep" or not recipe_named(options.recipe).masks_transients:
        return None
    return Transients(capture.train, capture.background, resume.transients if resume else None)


def _upload(
    engine: Engine, capture: PreparedCapture, start: Gaussians, transients: Transients | None, resume: Checkpoint | None
) -> None:
    """Give the engine everything that a run starts from."""
    engine.set_views(capture.train)
    if transients:
        transients.start(engine)
    engine.upload(start, resume.state if resume else None)
    if resume and resume.statistics:
        engine.restart_statistics(resume.statistics)


def _with_warnings(report: PriorReport | None, warnings: tuple[str, ...]) -> PriorReport | None:
    return replace(report, warnings=(*report.warnings, *warnings)) if report else None
