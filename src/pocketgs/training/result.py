"""What training gives: the scene, and what it took."""

from __future__ import annotations

from dataclasses import dataclass

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
        elapsed: seconds of all stages so far, looking at held-out views left out: when a run that never looks would
            have come as far.
        loss: of training.
        held_out_psnr: in dB.
        gaussians: their number.
    """

    iteration: int
    seconds: float
    elapsed: float
    loss: float
    held_out_psnr: float
    gaussians: int = 0


@dataclass(frozen=True)
class Checkpoint:
    """A run as it stands: enough to go on from.

    Attributes:
        iteration: iterations done.
        gaussians: the scene.
        state: the optimiser's.
        statistics: what its strategy has collected, or None where it collects nothing.
        course: what an open-ended run has learnt so far, or None where its length was given.
    """

    iteration: int
    gaussians: Gaussians
    state: OptimiserState
    statistics: Statistics | None = None
    course: Course | None = None


@dataclass(frozen=True)
class TrainingResult:
    """A trained scene, and what training took.

    Attributes:
        scene: the Gaussians.
        optimiser_state: for going on later.
        engine, recipe: their names.
        device: what the engine computed on.
        iterations: iterations done, those before a resumption included.
        resumed_from: iterations that an earlier run had done, or None; `seconds` and `losses` are of this run only.
        interrupted: whether Ctrl-C ended it.
        seconds: wall time by stage.
        peak_rss_mb: most memory that the process held, in MB of 10^6 bytes.
        engine_bytes: what the engine held, by name.
        losses: samples over the run.
        prior: what the geometry prior found, or None if there was none.
        strategy: name of what decided on the number of Gaussians.
        statistics: what it has collected since it last changed them, for going on later; None if nothing.
        course: what the validation views of an open-ended run said; None where its length was given.
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

    @property
    def checkpoint(self) -> Checkpoint:
        """What a later run needs to go on from here."""
        return Checkpoint(self.iterations, self.scene, self.optimiser_state, self.statistics, self.course)
