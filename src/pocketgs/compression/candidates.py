"""Candidates: the scene with fewer Gaussians, fine-tuned and rounded to the values that a file stores."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from pocketgs.compression.fine_tuning import RATE, FineTuner
from pocketgs.compression.judgement import Judge
from pocketgs.compression.pruning import Pruner
from pocketgs.compression.rounding import rounded_in_turn, steps_of_rounding
from pocketgs.compression.timekeeper import StoppedError, Timekeeper
from pocketgs.scene.formats.pgs import decode, encode
from pocketgs.scene.formats.pgs_coding import Coding
from pocketgs.scene.formats.pgs_rounding import rounded
from pocketgs.scene.gaussians import Gaussians

TUNING_STEPS, ROUNDING_STEPS = 800, 120
"""Training steps of a candidate before rounding, and after the rounding of each group but the last."""

STEPS = TUNING_STEPS + steps_of_rounding(ROUNDING_STEPS)

MASK_STEPS = 280
"""Minimum number of training steps of masks for a candidate."""

CANDIDATES = 3
"""Expected number of candidates of a search."""

PRUNING_STEPS, PRUNING_ROUNDS = 40, 8
"""Training steps of a round of pruning, and the expected number of rounds."""

PRUNING_TIME = 0.35
"""Share of the remaining time for pruning in rounds."""


@dataclass(frozen=True)
class Candidate:
    """A compressed scene. It is kept encoded, since a search keeps many.

    Attributes:
        count: number of Gaussians.
        contents: of the file.
        psnr: expected on views that it was not trained on, in dB; see `Judge`.
    """

    count: int
    contents: bytes
    psnr: float

    @property
    def scene(self) -> Gaussians:
        """The Gaussians, as the file stores them; decoded anew each time."""
        return decode(self.contents)

    @property
    def megabytes(self) -> float:
        """Size of the file."""
        return len(self.contents) / 1e6


@dataclass(frozen=True)
class Level:
    """The scene after a round of pruning, and its PSNR as for a candidate."""

    scene: Gaussians
    psnr: float


@dataclass
class Workshop:
    """Makes candidates.

    Attributes:
        tuner: trains.
        pruner: prunes.
        judge: measures.
        timekeeper: counts steps.
        coding: the grids of the file.
        is_within: whether a candidate is within the bound; once time is up, the first such candidate ends the work.
        levels: scenes after rounds of pruning, most Gaussians first.
        tuned: candidates before rounding; a candidate starts from the smallest sufficient one of these and the levels.
        candidates: made so far.
    """

    tuner: FineTuner
    pruner: Pruner
    judge: Judge
    timekeeper: Timekeeper
    coding: Coding
    is_within: Callable[[Candidate], bool]
    levels: list[Level] = field(default_factory=list)
    tuned: list[Gaussians] = field(default_factory=list)
    candidates: list[Candidate] = field(default_factory=list)

    def prune(self, scene: Gaussians, goes_on: Callable[[Level], bool]) -> None:
        """Prune in rounds, and keep the scene after each, as long as it `goes_on` and time allows."""
        self.timekeeper.expect(self.search_steps)
        used = self.timekeeper.used()
        for left in self.pruner.rounds(scene, PRUNING_STEPS):
            self.levels.append(Level(left, self.judge.psnr(left)))
            if self.timekeeper.used() > used + (1.0 - used) * PRUNING_TIME or not goes_on(self.levels[-1]):
                break
        self.timekeeper.expect(CANDIDATES * self.steps)

    def make(self, count: int) -> Candidate:
        """Make the candidate with this number of Gaussians.

        Raises:
            StoppedError: Ctrl-C was pressed, or time is up and a candidate is within the bound.
        """
        masking = round(self._share() * self.mask_steps)
        # Masks judge the whole scene, or what earlier masks kept of it: rounds may have removed what they would keep.
        levels = self.levels[:1] if self.pruner.trains_masks(masking) else self.levels
        starts = [*(level.scene for level in levels), *self.tuned]
        start = min((scene for scene in starts if len(scene) >= count), key=len)
        scene = self.pruner.at_once(start, count, masking)
        # A codebook changes a scene so much that gentle rates would not make up for it.
        rate = RATE if self.coding.entries else self.tuner.rate
        scene = self.tuner.tune(scene, round(self._share() * TUNING_STEPS), start=rate)
        self.tuned.append(scene)
        steps, weights = round(self._share() * ROUNDING_STEPS), self.pruner.weights(scene)
        scene = rounded_in_turn(scene, self.tuner, self.coding, steps, weights, rate)
        self.timekeeper.expected = max(self.timekeeper.expected, self.timekeeper.done + self.steps)
        return self._keep(scene, self.coding)

    @property
    def mask_steps(self) -> int:
        """Steps of training masks for a candidate: each view is used at least once."""
        return max(MASK_STEPS, len(self.pruner.cameras)) if self.pruner.method == "masks" else 0

    @property
    def steps(self) -> int:
        """Training steps of a candidate."""
        return self.mask_steps + STEPS

    @property
    def search_steps(self) -> int:
        """Approximate number of training steps of a search."""
        return PRUNING_ROUNDS * PRUNING_STEPS + CANDIDATES * self.steps

    def _share(self) -> float:
        """Share of the training steps that time allows."""
        return min(self.timekeeper.steps_left() / (CANDIDATES * self.steps), 1.0)

    def only_rounded(self, scene: Gaussians, coding: Coding) -> Candidate:
        """Make the candidate of a scene without pruning or training; raises the errors of `make`."""
        return self._keep(rounded(scene, coding), coding)

    def _keep(self, scene: Gaussians, coding: Coding) -> Candidate:
        self.candidates.append(Candidate(len(scene), encode(scene, coding), self.judge.psnr(scene)))
        self.timekeeper.check()
        if self.timekeeper.is_up() and any(map(self.is_within, self.candidates)):
            raise StoppedError
        return self.candidates[-1]
