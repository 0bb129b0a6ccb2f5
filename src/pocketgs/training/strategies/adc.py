"""3DGS's adaptive density control: cloning, splitting, pruning, and opacity resets (Kerbl et al. 2023, section 5.2)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pocketgs.scene.gaussians import Gaussians
from pocketgs.splat.engine import Engine
from pocketgs.splat.rows import RowChange, Statistics
from pocketgs.training.strategies.division import SHRINKING, drawn_within, logit
from pocketgs.training.strategies.pruning import at_least_one
from pocketgs.training.strategies.strategy import Collected, StrategyContext, StrategyDefaults

START, STOP, INTERVALS = 20, 2, 40
"""Densification begins after a twentieth of a short run, ends after a half, and takes place every fortieth."""


@dataclass(frozen=True)
class DensityControl:
    """Settings of adaptive density control; those of 3DGS for a run of 30,000 iterations.

    Attributes:
        start, stop, every: iterations between which Gaussians are densified, and the interval.
        gradient: minimum mean gradient of the centre on the image for densification.
        small: maximum size of a cloned Gaussian, as a share of the scene's extent; larger ones are split.
        faint: Gaussians of a lower opacity are pruned.
        large: maximum size, as a share of the extent; larger Gaussians are pruned after the first opacity reset.
        reset_every: iterations between opacity resets.
        reset_to: maximum opacity after a reset, as a multiple of `faint`.
    """

    start: int = 500
    stop: int = 15_000
    every: int = 100
    gradient: float = 2e-4
    small: float = 0.01
    faint: float = 0.005
    large: float = 0.1
    reset_every: int = 3000
    reset_to: float = 2.0

    @staticmethod
    def scaled(iterations: int) -> DensityControl:
        """The settings of a run of any length: 3DGS's, or earlier in shorter runs.

        Resets stay where they are: a scene takes hundreds of iterations to recover from one, whatever the run's length.

        Args:
            iterations: of the run.
        """
        published = DensityControl()
        return replace(
            published,
            start=min(published.start, iterations // START),
            stop=min(published.stop, iterations // STOP),
            every=min(published.every, max(iterations // INTERVALS, 1)),
        )


class AdaptiveDensityControl(StrategyDefaults):
    """3DGS's strategy, with a maximum number: if there is no room, the largest gradients take precedence."""

    name = "adc"
    changes_rows = True

    def __init__(self, context: StrategyContext, control: DensityControl | None = None) -> None:
        usual = DensityControl() if context.published_times else DensityControl.scaled(context.iterations)
        self._context, self._control = context, control or usual
        self._extent = context.measure_extent()

    def collected(self, iteration: int) -> Collected:
        """Gradients on the image, until densification ends."""
        return Collected(statistics=iteration < self._control.stop)

    def after_step(self, iteration: int, engine: Engine) -> None:
        """Densify and prune, then reset opacities; not after the last step, since no training would follow."""
        control = self._control
        if iteration >= min(control.stop, self._context.iterations):
            return
        if iteration > control.start and iteration % control.every == 0:
            engine.change_rows(self._refined(iteration, engine.download(), engine.statistics()))
        at_start = self._context.bright and iteration == control.start and control.reset_every < control.stop
        if iteration % control.reset_every == 0 or at_start:
            collected = engine.statistics()
            engine.change_rows(self._reset(engine.download()))
            engine.restart_statistics(collected)

    def _refined(self, iteration: int, scene: Gaussians, statistics: Statistics) -> RowChange:
        """Clone or split the Gaussians with large gradients, then prune."""
        control, context = self._control, self._context
        largest = scene.scales.max(axis=1)
        gradient = statistics.screen_gradients / np.maximum(statistics.seen, 1.0)
        growing = np.flatnonzero(gradient > control.gradient)
        room = max(context.most - len(scene), 0)
        if len(growing) > room:
            growing = np.sort(growing[np.argsort(-gradient[growing], kind="stable")[:room]])
        is_small = largest[growing] <= control.small * self._extent
        cloned, split = growing[is_small], growing[~is_small]
        whole = np.delete(np.arange(len(scene)), split)
        sources = np.concatenate([whole, cloned, split, split]).astype(np.int32)
        parts = slice(len(whole) + len(cloned), None)
        means, log_scales = scene.means[sources], scene.log_scales[sources]
        means[parts] = drawn_within(scene, sources[parts], context.random(iteration))
        log_scales[parts] -= np.float32(np.log(SHRINKING))
        is_kept = scene.opacities[sources] >= control.faint
        if iteration > control.reset_every:
            is_kept &= np.exp(log_scales).max(axis=1) <= control.large * self._extent
        is_kept = at_least_one(is_kept & np.isfinite(means).all(axis=1), means, scene.opacities[sources])
        is_new = np.arange(len(sources)) >= len(whole)
        rows = np.flatnonzero((np.arange(len(sources)) >= parts.start)[is_kept]).astype(np.int32)
        return RowChange(
            sources[is_kept],
            is_new[is_kept],
            {"means": (rows, means[is_kept][rows]), "log_scales": (rows, log_scales[is_kept][rows])},
        )

    def _reset(self, scene: Gaussians) -> RowChange:
        """Reduce opacities to at most that of the reset."""
        highest = logit(np.array(self._control.reset_to * self._control.faint))
        rows = np.arange(len(scene), dtype=np.int32)
        return RowChange.of_values(len(scene), {"opacity_logits": (rows, np.minimum(scene.opacity_logits, highest))})
