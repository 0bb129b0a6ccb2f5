"""The result of training: the scene, statistics of the run, and checkpoints."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pocketgs.prior.report import PriorReport
from pocketgs.scene.gaussians import Gaussians
from pocketgs.splat.engine import OptimiserState
from pocketgs.splat.rows import Statistics
from pocketgs.training.validation import ValidationHistory


@dataclass(frozen=True)
class LossSample:
    """Loss and held-out PSNR at one moment of training.

    Attributes:
        iteration: steps done.
        seconds: of training so far.
        elapsed: seconds of all stages so far, except evaluations on held-out views: the time that a run without them
            would have taken.
        loss: of training.
        held_out_psnr: mean over at most `MAX_EVALUATED` held-out views, evenly chosen, in dB.
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
        history: state of an open-ended run; None if its length was given.
        transients: (h, w) bool for each training view, its masked cells, see `pocketgs.training.transients`; None if
            transients were not searched for.
    """

    iteration: int
    gaussians: Gaussians
    state: OptimiserState
    statistics: Statistics | None = None
    history: ValidationHistory | None = None
    transients: tuple[np.ndarray, ...] | None = None


@dataclass(frozen=True)
class TrainingResult:
    """A trained scene, and statistics of its training.

    Attributes:
        checkpoint: the scene, and what resuming needs besides.
        engine, recipe, strategy: their names.
        device: of the engine.
        resumed_from: iterations of the earlier run, or None; `seconds` and `losses` are of this run only.
        interrupted: whether Ctrl-C ended it.
        seconds: wall time by stage.
        peak_rss_mb: peak memory of the process, in MB of 10^6 bytes.
        engine_bytes: the engine's memory, by name.
        losses: samples over the run.
        prior: report of the geometry prior, or None without one.
        left_out: names of the training views that training left out, since the other views contradict them.
        dropout: share of the Gaussians that each step left out.
    """

    checkpoint: Checkpoint
    engine: str
    device: str
    recipe: str
    strategy: str
    resumed_from: int | None
    interrupted: bool
    seconds: dict[str, float]
    peak_rss_mb: float
    engine_bytes: dict[str, int]
    losses: list[LossSample]
    prior: PriorReport | None
    left_out: tuple[str, ...]
    dropout: float

    @property
    def scene(self) -> Gaussians:
        """The Gaussians."""
        return self.checkpoint.gaussians

    @property
    def iterations(self) -> int:
        """Iterations done, including those before resuming."""
        return self.checkpoint.iteration
