"""Compression of a scene: prune, fine-tune and round it, and search for the smallest file within a bound."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from pocketgs.compression.candidates import Bench, Candidate, Level
from pocketgs.compression.fine_tuning import FineTuner
from pocketgs.compression.judgement import Judge
from pocketgs.compression.options import QUALITY, CompressionOptions
from pocketgs.compression.progress import Course, StoppedError
from pocketgs.compression.pruning import LEAST, Pruner
from pocketgs.compression.search import Goal, search
from pocketgs.compression.spz_file import as_spz
from pocketgs.compression.views import Views
from pocketgs.errors import PocketGSError
from pocketgs.scene.formats.pgs_coding import DEFAULT, FINE, Coding
from pocketgs.scene.gaussians import PARAMETERS, Gaussians
from pocketgs.splat.engine import Engine
from pocketgs.system.interrupt import deferred_interrupt

MB = 1_000_000

BYTES_PER_GAUSSIAN = 11
"""Of a file, about: where the search starts."""

RECOVERS = 0.8
"""dB that a candidate gains over the round of pruning that it starts from, about."""

SLACK = 1.6
"""Pruning in rounds ends so many dB below the bound."""

PACE = 0.1
"""Learning rates on renderings of the scene itself, relative to those on photographs: they are fitted already."""

DB_PER_FACTOR = 1.0
"""dB that a factor of e in the number of Gaussians makes, about."""

PSNR_TOLERANCE, SIZE_TOLERANCE = 0.04, 0.04
"""The search ends so many dB above a bound of quality, or so close below the logarithm of a size."""

FEWER = 0.8
"""Share of the Gaussians of the next candidate, as long as none is small enough."""

FINER, GRIDS = 0.7, 5
"""Steps of a grid relative to those of the next coarser one, and number of grids to choose from."""

MAKES_UP = 0.5
"""dB of rounding that training on renderings makes up for, about."""

COPIES = 12
"""Scenes in memory: rounds of pruning leave five in all; candidates, before and after rounding, are the rest."""


@dataclass(frozen=True)
class Compressed:
    """The result of a compression.

    Attributes:
        chosen: of the candidates.
        candidates: all, in the order in which they were made.
        original_psnr: PSNR of the original in dB, comparable with the candidates'.
        bound: least PSNR in dB, or None where the size was bounded.
        interrupted: whether Ctrl-C ended the search.
    """

    chosen: Candidate
    candidates: list[Candidate]
    original_psnr: float
    bound: float | None
    interrupted: bool

    @property
    def within_bound(self) -> bool:
        """Whether the bound of quality, if there is one, is kept."""
        return self.bound is None or self.chosen.psnr >= self.bound


def compress(
    scene: Gaussians,
    views: Views,
    engine: Engine,
    options: CompressionOptions | None = None,
    *,
    seconds: float | None = None,
    on_count: Callable[[int, int], None] = lambda done, of: None,
) -> Compressed:
    """Compress a scene.

    Ctrl-C ends the search with the best candidate within the bound; before there is one it raises KeyboardInterrupt.

    Args:
        scene: the original.
        views: see `photographed` and `rendered`.
        engine: trains and renders.
        options: None for the defaults.
        seconds: that the work may take, or None.
        on_count: called with the number of training steps done and the expected total.

    Raises:
        PocketGSError: no file is small enough, or no camera sees the scene.
    """
    options = options or CompressionOptions()
    scene = _drawable(scene)
    judge = Judge.of(scene, engine, views)
    bound = None if options.size is not None else _least_psnr(scene, views, judge, options.quality)
    with deferred_interrupt() as interrupt:
        course = Course(on_count, interrupt, seconds)
        pace = 1.0 if views.photographs else PACE
        tuner = FineTuner(engine, views.train, views.background, scene, options.seed, course.step, pace)
        pruner = Pruner(tuner, [frame.camera for frame in views.train], options.prune)
        bench = Bench(tuner, pruner, judge, course, DEFAULT)
        try:
            if bound is None:
                assert options.size is not None
                _search_by_size(scene, bench, options.size * MB)
            else:
                if not views.photographs:
                    bench.coding = _round_only(scene, bench, bound)
                _search_by_quality(scene, bench, bound)
                if not _within(bench.candidates, None, bound):
                    _round_only(scene, bench, bound)  # training did not bring back what rounding cost
        except StoppedError:
            if not _within(bench.candidates, options.size, bound):
                raise KeyboardInterrupt from None
    return Compressed(
        _best(bench.candidates, options.size, bound),
        bench.candidates,
        judge.original_psnr,
        bound,
        interrupt.requested,
    )


def memory_needed(scene: Gaussians, views: Views, engine: Engine) -> int:
    """Bytes that `compress` takes besides the scene and the views, at most."""
    sizes = [(frame.camera.width, frame.camera.height) for frame in views.train]
    of_scene = sum(getattr(scene, name).nbytes for name in PARAMETERS)
    return engine.memory_needed(len(scene), scene.sh.shape[1], sizes).process + COPIES * of_scene


def _drawable(scene: Gaussians) -> Gaussians:
    """The Gaussians without NaN and infinity, which no engine draws and no file holds."""
    finite = ~np.isnan(scene.opacity_logits)
    for name in ("means", "log_scales", "quaternions", "sh"):
        finite &= np.isfinite(getattr(scene, name).reshape(len(scene), -1)).all(axis=1)
    if not finite.any():
        raise PocketGSError("compression: found no Gaussian without NaN or infinity, expected at least one")
    return scene if finite.all() else scene.select(finite)


def _least_psnr(scene: Gaussians, views: Views, judge: Judge, quality: float | None) -> float:
    """The bound of quality in dB."""
    if views.photographs:
        return judge.original_psnr - (QUALITY if quality is None else quality)
    return judge.psnr(as_spz(scene).scene) - (quality or 0.0)


def _round_only(scene: Gaussians, bench: Bench, bound: float) -> Coding:
    """Make candidates of the whole scene on finer and finer grids until one is within the bound.

    Returns:
        The coarsest of these grids that training may bring within the bound.
    """
    coding, chosen = FINE, None
    for _ in range(GRIDS):
        psnr = bench.only_rounded(scene, coding).psnr
        if chosen is None and psnr >= bound - MAKES_UP:
            chosen = coding
        if psnr >= bound:
            break
        coding = finer(coding)
    return chosen or coding


def finer(coding: Coding) -> Coding:
    """The next finer grids."""
    names = ("position", "log_scale", "rotation", "opacity", "colour", "harmonics")
    return replace(coding, **{name: FINER * getattr(coding, name) for name in names})


def _search_by_size(scene: Gaussians, bench: Bench, size: float) -> None:
    guess = max(int(size / BYTES_PER_GAUSSIAN), LEAST)
    bench.prune(scene, lambda level: len(level.scene) > guess)
    goal = Goal(float(np.log(size)), 1.0, SIZE_TOLERANCE, from_above=False)
    search(lambda count: float(np.log(len(bench.make(count).contents))), goal, guess, LEAST, len(scene))
    # Small files shrink less than their number of Gaussians, which the search does not expect.
    fewest = min(bench.candidates, key=lambda each: len(each.contents))
    while len(fewest.contents) > size and len(fewest.scene) > LEAST:
        fewest = bench.make(max(int(FEWER * len(fewest.scene)), LEAST))


def _search_by_quality(scene: Gaussians, bench: Bench, bound: float) -> None:
    bench.prune(scene, lambda level: level.psnr > bound - SLACK)
    good: list[Level] = [level for level in bench.levels if level.psnr >= bound - RECOVERS]
    guess = len(min(good, key=lambda level: len(level.scene)).scene) if good else len(scene)
    goal = Goal(bound, DB_PER_FACTOR, PSNR_TOLERANCE, from_above=True)
    search(lambda count: bench.make(count).psnr, goal, guess, LEAST, len(scene))


def _within(candidates: list[Candidate], size: float | None, bound: float | None) -> list[Candidate]:
    if size is not None:
        return [candidate for candidate in candidates if candidate.megabytes <= size]
    return [candidate for candidate in candidates if bound is not None and candidate.psnr >= bound]


def _best(candidates: list[Candidate], size: float | None, bound: float | None) -> Candidate:
    """The best that fits, or the smallest that is good enough, or else the best.

    Raises:
        PocketGSError: none fits.
    """
    within = _within(candidates, size, bound)
    if size is not None:
        if not within:
            smallest = min(candidate.megabytes for candidate in candidates)
            raise PocketGSError(f"compression: the smallest file has {smallest:.3f} MB, expected --size {smallest:.3f}")
        return max(within, key=lambda candidate: candidate.psnr)
    return min(within, key=lambda candidate: candidate.megabytes, default=max(candidates, key=lambda each: each.psnr))
