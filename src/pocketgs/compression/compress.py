"""Compression of a scene: prune, fine-tune and round it, and search for the smallest file within a bound."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

from pocketgs.compression.bound import Bound, QualityBound, SizeBound
from pocketgs.compression.candidates import CANDIDATES, Candidate, Workshop
from pocketgs.compression.fine_tuning import RATE, FineTuner
from pocketgs.compression.judgement import Judge
from pocketgs.compression.options import QUALITY, CompressionOptions
from pocketgs.compression.pruning import Pruner
from pocketgs.compression.searches import search_by_size, search_on_photographs, search_on_renderings
from pocketgs.compression.spz_file import WRITING_SECONDS, rounded_as_spz
from pocketgs.compression.timekeeper import StoppedError, Timekeeper
from pocketgs.compression.views import Views
from pocketgs.errors import PocketGSError
from pocketgs.geometry.camera import Camera
from pocketgs.scene.edits import drawable
from pocketgs.scene.formats.pgs_coding import DEFAULT
from pocketgs.scene.gaussians import PARAMETERS, Gaussians
from pocketgs.scene.warning import warn
from pocketgs.splat.engine import Engine
from pocketgs.splat.rasterizer import Rasterizer
from pocketgs.system.device import MB
from pocketgs.system.interrupt import deferred_interrupt

RENDERING_RATE = 0.1 * RATE
"""Initial learning rates on renderings of the scene itself, relative to those of training: it fits them already."""

GENTLE_RATE = 0.3 * RATE
"""The same on photographs, for scenes that training at the usual rates makes worse."""

TRIAL_STEPS, TRIAL_TIME = 200, 0.05
"""Training steps to find that out, and their maximum share of the steps that the time limit allows."""

STEP = 3.0
"""Approximate time of a training step relative to a rendering, to estimate the speed before the first step."""

TABLE_ROWS = CANDIDATES + 3
"""Approximate number of scenes in the final comparison: candidates, one on fine grids, original, .spz."""

COMPARISON_SHARE = 0.2
"""Maximum share of the time to spend on a `.spz` that is only compared with."""

COPIES = 24
"""Number of scenes in memory: five from rounds of pruning, ten before rounding, one as a .spz holds it, those in work,
and while masks are trained the optimiser's and the gradients."""


@dataclass(frozen=True)
class Compressed:
    """The result of a compression.

    Attributes:
        chosen: the best candidate.
        candidates: all, in the order in which they were made.
        original_psnr: PSNR of the original in dB, comparable with the candidates'.
        bound: that the search was for.
        compares_spz: whether there is time to write a `.spz` to compare with.
        interrupted: whether Ctrl-C ended the search.
    """

    chosen: Candidate
    candidates: list[Candidate]
    original_psnr: float
    bound: Bound
    compares_spz: bool
    interrupted: bool

    @property
    def within_bound(self) -> bool:
        """Whether the result meets the bound."""
        return self.bound.admits(self.chosen)


def compress(
    scene: Gaussians,
    views: Views,
    engine: Engine,
    options: CompressionOptions | None = None,
    *,
    rasterizer: Rasterizer | None = None,
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
        rasterizer: computes the Gaussians' contributions; None for one on the CPU.
        seconds: time limit, including the final comparison on the reported views, or None. Once it is reached, only the
            work needed for a file within the bound is done.
        on_count: called with the number of training steps done and the expected total.

    Raises:
        PocketGSError: no file is small enough, or no camera sees the scene.
    """
    options = options or CompressionOptions()
    scene = drawable(scene)
    with deferred_interrupt() as interrupt:
        timekeeper = Timekeeper(on_count, interrupt, seconds)
        judge = Judge.of(scene, engine, views)
        rendering = max(timekeeper.elapsed(), 1e-3) / judge.renderings
        timekeeper.first_speed = 1.0 / (STEP * rendering)
        packing = WRITING_SECONDS * len(scene)
        compares_spz = packing <= COMPARISON_SHARE * timekeeper.seconds_left()
        timekeeper.reserve(TABLE_ROWS * len(views.reported) * rendering + compares_spz * packing)
        if options.size is None and not views.photographs:
            judge = judge.expecting(_stored(scene))
        bound = _bound(judge, options)
        tuner = FineTuner(engine, views.train, views.background, scene, options.seed, timekeeper.step)
        cameras = [frame.camera for frame in views.train]
        pruner = Pruner(tuner, cameras, options.prune, rasterizer or Rasterizer("cpu"))
        workshop = Workshop(tuner, pruner, judge, timekeeper, DEFAULT, bound.admits)
        try:
            timekeeper.check()
            tuner.rate = _suitable_rate(scene, workshop) if views.photographs else RENDERING_RATE
            _search(scene, views, workshop, bound)
        except StoppedError:
            if not any(map(bound.admits, workshop.candidates)):
                raise KeyboardInterrupt from None
        except PocketGSError as error:
            # Training has diverged, or a file cannot hold its result.
            if not any(map(bound.admits, workshop.candidates)):
                raise
            warn(f"compression: the search ended early: {error}")
    candidates = workshop.candidates
    return Compressed(
        bound.best(candidates),
        candidates,
        judge.original_psnr,
        bound,
        compares_spz,
        interrupt.requested,
    )


def memory_needed(scene: Gaussians, cameras: Iterable[Camera], engine: Engine) -> int:
    """Maximum bytes that `compress` takes besides the scene and the views.

    Args:
        scene: the original.
        cameras: of the views to fine-tune on.
        engine: trains and renders.
    """
    sizes = [(camera.width, camera.height) for camera in cameras]
    of_scene = sum(getattr(scene, name).nbytes for name in PARAMETERS)
    return engine.memory_needed(len(scene), scene.sh.shape[1], sizes).process + COPIES * of_scene


def _stored(scene: Gaussians) -> Gaussians:
    """The scene as a .spz holds it, whose quality is the bound without a capture.

    Raises:
        PocketGSError: a .spz cannot hold it in any unit of length.
    """
    try:
        return rounded_as_spz(scene)
    except PocketGSError as error:
        expected = "expected the capture, or --size, or a scene without far Gaussians (--crop-box of pocketgs convert)"
        raise PocketGSError(f"{error}, whose quality is the bound without a capture; {expected}") from error


def _bound(judge: Judge, options: CompressionOptions) -> SizeBound | QualityBound:
    """The bound that the options ask for."""
    if options.size is not None:
        return SizeBound(options.size)
    if judge.least is not None:
        return QualityBound(float(judge.least.mean()) - (options.quality or 0.0))
    allowed = QUALITY if options.quality is None else options.quality
    return QualityBound(judge.original_psnr - judge.loss_to_aim_at(allowed))


def _search(scene: Gaussians, views: Views, workshop: Workshop, bound: SizeBound | QualityBound) -> None:
    """Make candidates around the bound."""
    if isinstance(bound, SizeBound):
        search_by_size(scene, workshop, bound.megabytes * MB)
    elif views.photographs:
        search_on_photographs(scene, workshop, bound.psnr)
    else:
        search_on_renderings(scene, workshop, bound.psnr)


def _suitable_rate(scene: Gaussians, workshop: Workshop) -> float:
    """GENTLE_RATE if some training at the usual rates leaves the scene worse, as it does after long training."""
    steps = int(min(TRIAL_STEPS, TRIAL_TIME * workshop.timekeeper.steps_left()))
    if not steps:
        return RATE
    workshop.timekeeper.expect(steps + workshop.search_steps)
    trained = workshop.tuner.tune(scene, steps)
    judge = workshop.judge
    return RATE if judge.psnr_by_training_views(trained) >= judge.original_psnr else GENTLE_RATE
