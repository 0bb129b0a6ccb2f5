"""Budgeted growth: a scheduled number of Gaussians, added where the training views have errors.

Taming 3DGS (Mallick et al. 2024) grows along a parabola to an exact number, and chooses what to densify by scores;
FastGS (Ren et al. 2025) uses the errors of several views. Here the score is a Gaussian's contribution to the views'
errors, summed over the last views before each growth.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pocketgs.scene.gaussians import Gaussians
from pocketgs.splat.engine import Engine
from pocketgs.splat.rows import RowChange
from pocketgs.training.strategies.division import halves
from pocketgs.training.strategies.pruning import at_least_one
from pocketgs.training.strategies.strategy import Collected, StrategyContext, StrategyDefaults


@dataclass(frozen=True)
class Growth:
    """Settings of budgeted growth.

    Attributes:
        start, stop: shares of the run between which the number grows.
        times: number of growths.
        first: maximum initial number, as a share of the final number.
        views: maximum number of views whose errors are summed before each growth.
        faint: Gaussians of a lower opacity are pruned.
    """

    start: float = 0.02
    stop: float = 0.25
    times: int = 5
    first: float = 0.8
    views: int = 30
    faint: float = 0.01


class Parabola:
    """A parabolic schedule, fast at first, at fixed shares of a run of known length.

    Args:
        growth: the settings.
        iterations: of the run.
        most: final number of Gaussians.
    """

    def __init__(self, growth: Growth, iterations: int, most: int) -> None:
        self._first, self._most = growth.first, most
        grows = np.linspace(growth.start, growth.stop, growth.times) * iterations
        self._iterations = np.unique(np.maximum(grows.astype(int), 1))

    def next_growth(self, iteration: int) -> int | None:
        """The next iteration with a growth, from this one on."""
        ahead = self._iterations[self._iterations >= iteration]
        return int(ahead[0]) if len(ahead) else None

    def target(self, iteration: int, count: int) -> int:
        """The target of the parabola, whatever the current number."""
        last, first = self._iterations[-1], self._iterations[0]
        left = np.clip((last - iteration) / max(last - first, 1), 0.0, 1.0)
        return int(self._most * (1.0 - (1.0 - self._first) * left**2))


class Budgeted(StrategyDefaults):
    """Splits the Gaussians that contribute most to errors, and prunes faint ones, according to a schedule."""

    name = "budgeted"
    changes_rows = True

    def __init__(self, context: StrategyContext, growth: Growth | None = None) -> None:
        self._context, self._growth = context, growth or Growth()
        self._plan = context.growth or Parabola(self._growth, context.iterations, context.most)

    def collected(self, iteration: int) -> Collected:
        """Errors, in the last steps before a growth."""
        ahead = self._plan.next_growth(iteration)
        views = min(self._growth.views, self._context.views)
        return Collected(errors=ahead is not None and ahead - iteration < views)

    def after_step(self, iteration: int, engine: Engine) -> None:
        """Prune and split, if the schedule says so."""
        if self._plan.next_growth(iteration) == iteration:
            target = self._plan.target(iteration, engine.count)
            engine.change_rows(self._grown(engine.download(), engine.statistics().errors, target))

    def _grown(self, scene: Gaussians, errors: np.ndarray, target: int) -> RowChange:
        is_kept = (scene.opacities >= self._growth.faint) & np.isfinite(scene.means).all(axis=1)
        kept = np.flatnonzero(at_least_one(is_kept, scene.means, scene.opacities))
        wanted = min(max(target - len(kept), 0), len(kept))
        split = np.sort(kept[np.argsort(-errors[kept], kind="stable")[:wanted]])
        sources = np.concatenate([kept, split]).astype(np.int32)
        offsets, log_scales, logits = halves(scene, split)
        ones = np.searchsorted(kept, split).astype(np.int32)
        others = np.arange(len(kept), len(sources), dtype=np.int32)
        rows = np.concatenate([ones, others])
        means = np.concatenate([scene.means[split] + offsets, scene.means[split] - offsets])
        fresh = np.zeros(len(sources), np.bool_)
        fresh[rows] = True
        return RowChange(
            sources,
            fresh,
            {
                "means": (rows, means),
                "log_scales": (rows, np.concatenate([log_scales, log_scales])),
                "opacity_logits": (rows, np.concatenate([logits, logits])),
            },
        )
