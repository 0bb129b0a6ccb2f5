"""The training loop. It is independent of the engine."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from pocketgs.capture.capture import Capture
from pocketgs.errors import PocketGSError
from pocketgs.metrics.evaluation import psnr
from pocketgs.prior.prior import PreparedCapture
from pocketgs.scene.morton import morton_order
from pocketgs.splat.engine import Engine, create_engine
from pocketgs.splat.rows import Statistics
from pocketgs.splat.settings import LearningRates, StepSettings
from pocketgs.system.interrupt import Interrupt, deferred_interrupt
from pocketgs.system.process import peak_rss_mb
from pocketgs.system.stopwatch import Stopwatch
from pocketgs.training.colours import colour_settings
from pocketgs.training.open_ended import OpenEndedPace
from pocketgs.training.options import SizedOptions, TrainingOptions
from pocketgs.training.pace import Pace, SetPace
from pocketgs.training.planning.effort import sized
from pocketgs.training.preparation import prepare
from pocketgs.training.progress import Observer, Progress
from pocketgs.training.recipes import Recipe, camera_extent, recipe_named
from pocketgs.training.result import Checkpoint, LossSample, TrainingResult
from pocketgs.training.seeding import SEEDINGS
from pocketgs.training.strategies.choose import create_strategy
from pocketgs.training.strategies.strategy import GrowthPlan, Situation, Strategy
from pocketgs.training.transients import Transients
from pocketgs.training.validation import render_frame
from pocketgs.training.view_choice import view_of_step

SECONDS_BETWEEN_LOSSES = 0.5


def train(
    capture: Capture,
    options: TrainingOptions | None = None,
    *,
    observer: Observer | None = None,
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
        observer: called after every iteration.
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
    recipe = recipe_named(options.recipe)
    prepared = capture if isinstance(capture, PreparedCapture) else prepare(capture, options, stopwatch)
    with stopwatch.stage("seeding"):
        if prepared.points is None:
            raise PocketGSError(f"{prepared.path}: no points to start from, expected what `prepare` gives")
        unit = recipe.length([frame.camera for frame in prepared.train], prepared.points)
        degree = recipe.sh_degree if options.sh_degree is None else options.sh_degree
        seed = SEEDINGS[options.seeds]
        if resume:
            start = resume.gaussians
        else:
            start = seed(prepared.points, recipe.opacity, degree, recipe.seed_size)
            # Neighbours in memory form clusters that most views can skip.
            start = start.select(morton_order(start.means))
    with stopwatch.stage("compilation"):
        engine = opened_engine or create_engine(options.engine_options)
        engine.prepare()
    transients = None
    if options.transients == "mask" and recipe.masks_transients:
        transients = Transients(prepared.train, prepared.background, resume.transients if resume else None)
    with stopwatch.stage("upload"):
        engine.set_views(prepared.train)
        if transients:
            transients.start(engine)
        engine.upload(start, resume.state if resume else None)
        if resume and resume.statistics:
            engine.restart_statistics(resume.statistics)
    seconds = None if options.time_budget is None else options.time_budget - (time.monotonic() - started)
    rates = recipe.rates_for(options.iterations, unit)
    course = resume.course if resume else None
    pace: Pace
    growth: GrowthPlan | None = None
    if options.open_ended:
        views, background = prepared.train, prepared.background
        pace = growth = OpenEndedPace(
            options.iterations, seconds, rates, views, background, options.max_gaussians, course
        )
    else:
        pace = SetPace(options.iterations, seconds, recipe.schedule, rates, len(prepared.train), course)
    strategy = create_strategy(options.strategy, _situation(prepared, options, growth))
    first = resume.iteration if resume else 0
    loop = _Loop(prepared, options, recipe, strategy, pace, transients, rates, engine, stopwatch, first)
    loop.run(observer)
    if loop.interrupted and loop.iteration == 0:
        raise KeyboardInterrupt
    return TrainingResult(
        scene=engine.download(),
        optimiser_state=engine.optimiser_state(),
        engine=engine.name,
        device=engine.device,
        recipe=recipe.name,
        iterations=loop.iteration,
        resumed_from=resume.iteration if resume else None,
        interrupted=loop.interrupted,
        seconds=dict(stopwatch.seconds),
        peak_rss_mb=peak_rss_mb(),
        engine_bytes=engine.memory(),
        losses=loop.samples,
        prior=prepared.report,
        strategy=strategy.name,
        statistics=loop.statistics(),
        course=pace.course,
        transients=transients.cells if transients else None,
    )


def _situation(capture: PreparedCapture, options: SizedOptions, growth: GrowthPlan | None) -> Situation:
    points = capture.points
    assert points is not None
    return Situation(
        iterations=options.iterations,
        most=options.max_gaussians,
        measure_extent=lambda: camera_extent([frame.camera for frame in capture.train], points),
        views=len(capture.train),
        seed=options.seed,
        bright=max(capture.background) > 0,
        growth=growth,
    )


class _Loop:
    """State of a run between iterations."""

    def __init__(
        self,
        capture: PreparedCapture,
        options: SizedOptions,
        recipe: Recipe,
        strategy: Strategy,
        pace: Pace,
        transients: Transients | None,
        rates: LearningRates,
        engine: Engine,
        stopwatch: Stopwatch,
        iteration: int,
    ) -> None:
        self.iteration = self._first_iteration = iteration
        self.interrupted = False
        self.samples: list[LossSample] = []
        self._capture, self._options, self._recipe, self._strategy = capture, options, recipe, strategy
        self._pace, self._transients, self._first_rates = pace, transients, rates
        self._learns_colours = options.colours == "on"
        self._engine, self._stopwatch = engine, stopwatch
        self._loss, self._loss_asked = float("nan"), float("-inf")
        self._held_out_psnr: float | None = None

    def statistics(self) -> Statistics | None:
        """Statistics for the strategy, or None if it needs none."""
        return self._engine.statistics() if self._strategy.name != "fixed" else None

    def run(self, observer: Observer | None) -> None:
        """Iterate until the pace ends the run, or Ctrl-C is pressed."""
        started = time.monotonic()
        with deferred_interrupt() as interrupt:
            while self._pace.fraction(self.iteration, time.monotonic() - started) < 1.0:
                if interrupt.requested:
                    self.interrupted = True
                    break
                with self._stopwatch.stage("training"):
                    self._step(started)
                self._look_at_held_out_views()
                if observer:
                    progress, before = self._progress(started, interrupt), time.monotonic()
                    observer(progress)
                    started += time.monotonic() - before  # an observer's pauses do not count
            if self.iteration > self._first_iteration:
                self._finish_steps()

    def _step(self, started: float) -> None:
        seconds = time.monotonic() - started
        rates, number = self._pace.rates(self.iteration, seconds), self.iteration + 1
        collected = self._strategy.collected(number)
        settings = StepSettings(
            rates,
            self._strategy.loss(self._recipe.loss),
            self._recipe.adam,
            self._capture.background,
            self._recipe.active_degree(number),
            collected.statistics,
            collected.errors,
            self._strategy.noise(number, rates.means / self._first_rates.means),
            colour_settings(rates.sh_dc / self._first_rates.sh_dc) if self._learns_colours else None,
            collected.absolute,
        )
        self._engine.step(self._next_view(), settings)
        self._pace.after_step(number, seconds, self._engine)
        self._strategy.after_step(number, self._engine)
        if self._transients and number < self._pace.iterations:
            self._transients.after_step(number, self._engine, self._pace.views(number))
        self.iteration = number

    def _next_view(self) -> int:
        views = self._pace.views(self.iteration)
        return views[view_of_step(self.iteration, len(views), self._options.seed)]

    def _look_at_held_out_views(self) -> None:
        every = self._options.evaluate_every
        if not every or self.iteration % every or not self._capture.held_out:
            return
        self._finish_steps()
        with self._stopwatch.stage("evaluation"):
            values = [
                psnr(render_frame(self._engine, frame, self._capture.background), frame.image / 255.0, frame.mask)
                for frame in self._capture.held_out
            ]
        self._held_out_psnr = float(np.mean(values))
        seconds = self._stopwatch.seconds
        elapsed = sum(seconds.values()) - seconds["evaluation"]
        self.samples.append(
            LossSample(
                self.iteration, seconds["training"], elapsed, self._loss, self._held_out_psnr, self._engine.count
            )
        )

    def _finish_steps(self) -> None:
        """Read the mean loss over the last epoch, which waits until the engine has finished all steps."""
        with self._stopwatch.stage("training"):
            self._loss = self._engine.loss(min(len(self._capture.train), self.iteration - self._first_iteration))
        self._loss_asked = time.monotonic()

    def _progress(self, started: float, interrupt: Interrupt) -> Progress:
        if time.monotonic() - self._loss_asked > SECONDS_BETWEEN_LOSSES:
            self._finish_steps()
        elapsed = time.monotonic() - started
        rate = (self.iteration - self._first_iteration) / max(elapsed, 1e-9)
        fraction = self._pace.fraction(self.iteration, elapsed)
        left = (self._pace.iterations - self.iteration) / rate
        if fraction > self.iteration / self._pace.iterations:
            left = min(left, elapsed / fraction - elapsed)
        return Progress(
            iteration=self.iteration,
            iterations=self._pace.iterations,
            fraction=fraction,
            loss=self._loss,
            held_out_psnr=self._held_out_psnr,
            iteration_rate=rate,
            seconds_left=left,
            gain_per_minute=self._pace.course.gain_per_minute if self._pace.course else None,
            gaussians=self._engine.count,
            interrupt=interrupt,
            scene=self._engine.download,
            checkpoint=lambda: Checkpoint(
                self.iteration,
                self._engine.download(),
                self._engine.optimiser_state(),
                self.statistics(),
                self._pace.course,
                self._transients.cells if self._transients else None,
            ),
        )
