"""A training run that pages can follow, pause, resume and stop."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from typing import Final, Literal, TypeVar

import numpy as np

from pocketgs.capture.capture import Capture
from pocketgs.errors import PocketGSError
from pocketgs.results.reporter import Reporter
from pocketgs.results.run import RunResult
from pocketgs.scene.edits import cropped, drawable
from pocketgs.scene.formats import spz
from pocketgs.scene.formats.spz_attributes import MAX_FIXED
from pocketgs.scene.gaussians import Gaussians
from pocketgs.system.process import peak_rss_mb
from pocketgs.training.progress import Progress
from pocketgs.viewer.content import Content, capture_views, looked_at
from pocketgs.viewer.news import News
from pocketgs.viewer.scene_content import previews_in, with_transients

Command = Literal["pause", "resume", "stop"]
_Fact = TypeVar("_Fact")

SECONDS_BETWEEN_MESSAGES = 0.25
SECONDS_BETWEEN_SCENES = 2.0
SECONDS_BETWEEN_GLANCES = 0.1
"""How often a paused run checks for commands, Ctrl-C and new pages."""

SPZ_VERSION: Final = 3
"""The last version whose compression browsers decode natively."""

MAX_SAMPLES = 1000
"""Maximum number of points of the curves."""


class LiveRun:
    """Publishes a run to pages, and obeys their commands.

    The training thread calls the reporter and `finish`; the server's thread reads `news` and calls `obey`. Training
    never waits for pages, unless it is paused.

    Args:
        title: a short name.
        stages: display names of stages; others keep their names.
    """

    def __init__(self, title: str, stages: dict[str, str] | None = None) -> None:
        self.news = News(Content(title, live=True))
        self._stages, self._stage = stages or {}, ""
        self._changed = threading.Condition()
        self._paused = self._stop_asked = self._over = False
        self._told = self._scene_taken = float("-inf")
        self._sampled_fraction = -1.0
        self._warn: Callable[[str], None] = lambda warning: None
        self._encoder = ThreadPoolExecutor(1, "pocketgs-snapshot")
        self._encoding: Future[None] | None = None
        self._scene_iteration = 0

    def reporter(self, shown: Reporter) -> Reporter:
        """A reporter that forwards to another one, and to the pages."""
        self._warn = shown.on_warning
        return replace(
            shown,
            on_stage=_both(shown.on_stage, self._show_stage),
            on_count=self._counting(shown.on_count),
            on_plan=_both(shown.on_plan, lambda plan: self.news.post_progress(iterations=plan.iterations)),
            on_capture=_both(shown.on_capture, self._show_capture),
            on_prepared=_both(shown.on_prepared, self._show_capture),
            on_progress=_both(shown.on_progress, self._observe),
        )

    def obey(self, command: Command) -> None:
        """Execute a page's command; ignored once the run has ended.

        "stop" acts like Ctrl-C during training: the run ends after the current step and keeps its scene. Before the
        first step it is remembered.
        """
        with self._changed:
            if self._over:
                return
            self._stop_asked |= command == "stop"
            self._paused = command == "pause" and not self._stop_asked
            self.news.post_progress(paused=self._paused)
            self._changed.notify_all()

    def finish(self, result: RunResult) -> None:
        """Show the result of the run."""
        with self._changed:
            self._over = True
        content, folder = self.news.content, result.folder
        views = with_transients(content.views, folder)
        self.news.post_content(replace(content, views=views, previews=previews_in(folder)))
        iteration = int(result.summary["iterations"])
        self._encoder.submit(self._encode, iteration, result.scene).result()
        self._encoder.shutdown()
        count = len(result.scene)
        end = {"stage": "finished", "paused": False, "finished": True}
        self.news.post_progress(iteration=iteration, seconds_left=0.0, gaussians=count, **end)

    def _show_stage(self, stage: str) -> None:
        # Every training step is a stage.
        if stage != self._stage:
            self._stage = stage
            self.news.post_progress(stage=self._stages.get(stage, stage), memory_mb=peak_rss_mb())

    def _counting(self, shown: Callable[[int, int], None]) -> Callable[[int, int], None]:
        def show(done: int, of: int) -> None:
            shown(done, of)
            if done == of or time.monotonic() - self._told >= SECONDS_BETWEEN_MESSAGES:
                self._told = time.monotonic()
                self.news.post_progress(stage=f"{self._stages.get(self._stage, self._stage)}: {done} of {of}")

        return show

    def _show_capture(self, capture: Capture) -> None:
        self.news.post_content(_with_cameras(self.news.content, capture))

    def _observe(self, progress: Progress) -> None:
        is_last = progress.iteration >= progress.iterations
        if is_last or time.monotonic() - self._told >= SECONDS_BETWEEN_MESSAGES:
            self._told = time.monotonic()
            self._show_progress(progress)
        self._offer_scene(progress)
        if self._paused:
            self._wait(progress)
        if self._stop_asked:
            progress.interrupt.requested = True

    def _show_progress(self, progress: Progress) -> None:
        loss, held_out_psnr = _finite(progress.loss), _finite(progress.held_out_psnr)
        self.news.post_progress(
            iteration=progress.iteration,
            iterations=progress.iterations,
            loss=loss,
            held_out_psnr=held_out_psnr,
            seconds_left=_finite(progress.seconds_left),
            gaussians=progress.gaussians,
            memory_mb=peak_rss_mb(),
        )
        if progress.fraction - self._sampled_fraction >= 1 / MAX_SAMPLES:
            self._sampled_fraction = progress.fraction
            self.news.post_sample(progress.iteration, loss, held_out_psnr)

    def _offer_scene(self, progress: Progress) -> None:
        """Publish the current scene, if a page is open and the last one is old enough."""
        if not self.news.readers or progress.iteration == self._scene_iteration:
            return
        is_busy = self._encoding is not None and not self._encoding.done()
        if is_busy or time.monotonic() - self._scene_taken < SECONDS_BETWEEN_SCENES:
            return
        scene = progress.scene()
        self._scene_taken, self._scene_iteration = time.monotonic(), progress.iteration
        self._encoding = self._encoder.submit(self._encode, progress.iteration, scene)

    def _encode(self, iteration: int, scene: Gaussians) -> None:
        """Publish a scene without the Gaussians that the format cannot hold, which may come and go during training."""
        farthest = np.full(3, MAX_FIXED)
        try:
            shown = cropped(drawable(scene), -farthest, farthest)
            self.news.post_scene(iteration, spz.encode(shown, SPZ_VERSION))
        except PocketGSError as error:  # such as a scene that has diverged
            self._warn(f"iteration {iteration} cannot be shown on the page: {error}")

    def _wait(self, progress: Progress) -> None:
        """Wait until a page resumes the run, or Ctrl-C is pressed."""
        while self._paused and not progress.interrupt.requested:
            self._offer_scene(progress)
            with self._changed:
                self._changed.wait_for(lambda: not self._paused, SECONDS_BETWEEN_GLANCES)
        if progress.interrupt.requested:
            self.obey("stop")


def _both(first: Callable[[_Fact], None], second: Callable[[_Fact], None]) -> Callable[[_Fact], None]:
    def tell(fact: _Fact) -> None:
        first(fact)
        second(fact)

    return tell


def _with_cameras(content: Content, capture: Capture) -> Content:
    views = capture_views(capture)
    up, target = looked_at(views)
    return replace(content, background=capture.background, views=views, up=up, target=target)


def _finite(value: float | None) -> float | None:
    """Convert NaN to null for JSON; the loss is NaN until it is first read."""
    return value if value is not None and math.isfinite(value) else None
