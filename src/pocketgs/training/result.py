"""The result of training: the scene, statistics of the run, and checkpoints."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pocketgs.prior.report import PriorReport
from pocketgs.scene.gaussians import Gaussians
from pocketgs.splat.engine import OptimiserState
from pocketgs.splat.rows import Statistics
from pocketgs.training.validation import Course


@dataclass(frozen=True)
class LossSample:
    """Loss and held-out PSNR at one moment of training.

    Attributes:
        iteration: steps done.
        seconds: of training so far.
        elapsed: seconds of all stages so far, except evaluations on held-out views: the time that a run without them
            would have taken.
        loss: of training.
        held_out_psnr: in dB.
        gaussians: number of Gaussians.
    """

    iteration: int
    seconds: float
    elapsed: float
    loss: float
    held_out_psnr: float
    gaussians: int = 0


@dataclass(frozen=True)
class Checkpoint:
    """The state of a run, from which it can be resumed.

    Attributes:
        iteration: iterations done.
        gaussians: the scene.
        state: the optimiser's state.
        statistics: collected by its strategy, or None.
        course: state of an open-ended run; None if its length was given.
        transients: (h, w) bool for each training view, its masked cells; None if transients were not searched for.
    """

    iteration: int
    gaussians: Gaussians
    state: OptimiserState
    statistics: Statistics | None = None
    course: Course | None = None
    transients: tuple[np.ndarray, ...] | None = None


@dataclass(frozen=True)
class TrainingResult:
    """A trained scene, and statistics of its training.

    Attributes:
        scene: the Gaussians.
        optimiser_state: for resuming.
        engine, recipe: their names.
        device: of the engine.
        iterations: iterations done, including those before resuming.
        resumed_from: iterations of the earlier run, or None; `seconds` and `losses` are of this run only.
        interrupted: whether Ctrl-C ended it.
        seconds: wall time by stage.
        peak_rss_mb: peak memory of the process, in MB of 10^6 bytes.
        engine_bytes: the engine's memory, by name.
        losses: samples over the run.
        prior: report of the geometry prior, or None without one.
        strategy: name of the strategy.
        statistics: collected by the strategy since its last change, for resuming; None if nothing.
        course: evaluations on the validation views of an open-ended run; None if its length was given.
        transients: (h, w) bool for each training view, its masked cells, see `pocketgs.training.transients`; None if
            transients were not searched for.
        left_out: names of the training views that training left out, since the other views contradict them.
    """

    scene: Gaussians
    optimiser_state: OptimiserState
    engine: str
    device: str
    recipe: str
    iterations: int
    resumed_from: int | None
    interrupted: bool
    seconds: dict[str, float]
    peak_rss_mb: float
    engine_bytes: dict[str, int]
    losses: list[LossSample]
    prior: PriorReport | None = None
    strategy: str = "fixed"
    statistics: Statistics | None = None
    course: Course | None = None
    transients: tuple[np.ndarray, ...] | None = None
    left_out: tuple[str, ...] = ()

    @property
    def checkpoint(self) -> Checkpoint:
        """The checkpoint for resuming."""
        return Checkpoint(
            self.iterations, self.scene, self.optimiser_state, self.statistics, self.course, self.transients
        )
