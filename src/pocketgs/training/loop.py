"""The training loop. It is independent of the engine."""

from __future__ import annotations

import time

from pocketgs.capture.even_choice import evenly_chosen
from pocketgs.prior.prior import PreparedCapture
from pocketgs.splat.engine import Engine
from pocketgs.splat.settings import StepSettings
from pocketgs.system.interrupt import Interrupt
from pocketgs.system.stopwatch import Stopwatch
from pocketgs.training.colours import colour_settings
from pocketgs.training.dropout import dropout_of_step
from pocketgs.training.options import SizedOptions
from pocketgs.training.progress import MAX_EVALUATED, Observer, Progress
from pocketgs.training.result import Checkpoint, LossSample
from pocketgs.training.run_setup import RunSetup
from pocketgs.training.transients import Transients
from pocketgs.training.validation import mean_psnr
from pocketgs.training.view_choice import view_of_step

SECONDS_BETWEEN_LOSSES = 0.5


class Loop:
    """State of a run between iterations.

    Args:
        capture: to train on.
        options: of the run.
        setup: what it follows.
        transients: masks things that move, or None.
        engine: with the views and the first Gaussians.
        stopwatch: times the stages.
        iteration: number of steps that the Gaussians have behind them.
    """

    def __init__(
        self,
        capture: PreparedCapture,
        options: SizedOptions,
        setup: RunSetup,
        transients: Transients | None,
        engine: Engine,
        stopwatch: Stopwatch,
        iteration: int,
    ) -> None:
        self.iteration = self._first_iteration = iteration
        self.interrupted = False
        self.samples: list[LossSample] = []
        self._capture, self._options, self._transients = capture, options, transients
        self._recipe, self._first_rates = setup.recipe, setup.first_rates
        self._pace, self._strategy = setup.pace, setup.strategy
        self._dropout = setup.dropout
        self._learns_colours = options.colours == "on"
        self._engine, self._stopwatch = engine, stopwatch
        self._loss, self._loss_asked = float("nan"), float("-inf")
        self._held_out_psnr: float | None = None
        held_out = capture.held_out
        self._evaluated = [held_out[place] for place in evenly_chosen(len(held_out), MAX_EVALUATED)]

    def checkpoint(self) -> Checkpoint:
        """A copy of the current state, from which the run can be resumed."""
        return Checkpoint(
            self.iteration,
            self._engine.download(),
            self._engine.optimiser_state(),
            self._engine.statistics() if self._strategy.changes_rows else None,
            self._pace.history,
            self._transients.cells if self._transients else None,
        )

    def run(self, observer: Observer | None, saver: Observer | None, interrupt: Interrupt) -> None:
        """Iterate until the pace ends the run, or a stop is requested.

        Args:
            observer: called after every iteration, or None. Its time does not count.
            saver: called after every iteration, or None. Its time counts.
            interrupt: requests a stop.
        """
        started = time.monotonic()
        while self._pace.fraction(self.iteration, time.monotonic() - started) < 1.0:
            if interrupt.requested:
                self.interrupted = True
                break
            with self._stopwatch.stage("training"):
                self._step(started)
            self._look_at_held_out_views()
            if observer or saver:
                progress = self._progress(started, interrupt)
            if observer:
                before = time.monotonic()
                observer(progress)
                started += time.monotonic() - before  # an observer's pauses do not count
            if saver:
                saver(progress)
        if self.iteration > self._first_iteration:
            self._finish_steps()

    def _step(self, started: float) -> None:
        seconds = time.monotonic() - started
        rates, number = self._pace.rates(self.iteration, seconds), self.iteration + 1
        collected = self._strategy.collected(number)
        settings = StepSettings(
            rates=rates,
            loss=self._strategy.loss(self._recipe.loss),
            adam=self._recipe.adam,
            background=self._capture.background,
            sh_degree=self._recipe.active_degree(number),
            statistics=collected.statistics,
            errors=collected.errors,
            noise=self._strategy.noise(number, rates.means / self._first_rates.means),
            dropout=dropout_of_step(self._dropout, number, self._options.seed),
            colours=colour_settings(rates.sh_dc / self._first_rates.sh_dc) if self._learns_colours else None,
        )
        self._engine.step(self._next_view(), settings)
        self._pace.after_step(number, seconds, self._engine)
        self._strategy.after_step(number, self._engine)
        if self._transients and number < self._pace.iterations:
            self._transients.after_step(number, self._engine, self._pace.familiar_views(number))
        self.iteration = number

    def _next_view(self) -> int:
        views = self._pace.views(self.iteration)
        if self._transients:
            views = self._transients.used(views)
        return views[view_of_step(self.iteration, len(views), self._options.seed)]

    def _look_at_held_out_views(self) -> None:
        """Measure the PSNR of at most MAX_EVALUATED held-out views now and then; the final figures are of them all."""
        every = self._options.evaluate_every
        if not every or self.iteration % every or not self._evaluated:
            return
        self._finish_steps()
        with self._stopwatch.stage("evaluation"):
            self._held_out_psnr = mean_psnr(self._engine, self._evaluated, self._capture.background)
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
            gain_per_minute=self._pace.history.gain_per_minute if self._pace.history else None,
            gaussians=self._engine.count,
            interrupt=interrupt,
            scene=self._engine.download,
            checkpoint=self.checkpoint,
        )
