"""3DGS-MCMC: relocation of dead Gaussians, and noise on positions (Kheradmand et al. 2024)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pocketgs.scene.gaussians import Gaussians
from pocketgs.splat.engine import Engine
from pocketgs.splat.rows import RowChange
from pocketgs.splat.settings import LossSettings, PositionNoise
from pocketgs.training.strategies.division import logit
from pocketgs.training.strategies.relocation import compute_relocation
from pocketgs.training.strategies.strategy import Collected, StrategyContext

MAX_OPACITY = 1.0 - 1e-6

INTERVALS = 40
"""Intervals between relocations in a short run: the number of Gaussians doubles in 15 of them."""


@dataclass(frozen=True)
class Relocation:
    """Settings of 3DGS-MCMC; the paper's, except that times are relative to the length of the run.

    Attributes:
        start, stop: shares of the run between which Gaussians are relocated: 500 and 25,000 of the paper's 30,000.
        every: iterations between relocations; in short runs, see `scaled`.
        dead: maximum opacity of a dead Gaussian.
        growth: relative growth of the number of Gaussians per relocation, up to the run's maximum.
        noise: λ_noise times the paper's rate of the means, 5e5 x 1.6e-4, for a scene of extent 1.
        opacity_weight, size_weight: of the mean opacity, and of the mean standard deviation in a scene of extent 1.
    """

    start: float = 500 / 30_000
    stop: float = 25_000 / 30_000
    every: int = 100
    dead: float = 0.005
    growth: float = 0.05
    noise: float = 80.0
    opacity_weight: float = 0.01
    size_weight: float = 0.01

    @staticmethod
    def scaled(iterations: int) -> Relocation:
        """The settings of a run of this many iterations: in short ones Gaussians are relocated more often."""
        published = Relocation()
        return replace(published, every=min(published.every, max(iterations // INTERVALS, 1)))


class MCMC:
    """The strategy of 3DGS-MCMC: relocation, growth, noise, and regularisation of opacity and size."""

    name = "mcmc"
    changes_rows = True

    def __init__(self, context: StrategyContext, relocation: Relocation | None = None) -> None:
        usual = Relocation() if context.published_times else Relocation.scaled(context.iterations)
        self._context, self._relocation = context, relocation or usual
        self._extent = context.measure_extent()

    def collected(self, iteration: int) -> Collected:
        """Nothing."""
        return Collected()

    def loss(self, loss: LossSettings) -> LossSettings:
        """Regularise opacity and size, so that Gaussians that are not needed die and can be relocated."""
        # Our term is the mean over a Gaussian's three axes, the weight is for their sum.
        size_weight = self._relocation.size_weight / 3.0 / self._extent
        return replace(loss, opacity_weight=self._relocation.opacity_weight, size_weight=size_weight)

    def noise(self, iteration: int, slowness: float) -> PositionNoise | None:
        """Noise in proportion to the learning rate of the means."""
        seed = int(np.random.default_rng((self._context.seed, iteration, 2)).integers(2**32))
        return PositionNoise(self._relocation.noise * slowness / self._extent, seed)

    def after_step(self, iteration: int, engine: Engine) -> None:
        """Relocate dead Gaussians, and grow."""
        relocation, iterations = self._relocation, self._context.iterations
        is_time = relocation.start * iterations < iteration < relocation.stop * iterations
        if is_time and iteration % relocation.every == 0:
            self._relocate(engine, iteration)

    def _relocate(self, engine: Engine, iteration: int) -> None:
        """Relocate dead Gaussians, then add copies."""
        rng = self._context.random(iteration)
        scene = engine.download()
        is_dead = ~(scene.opacities > self._relocation.dead) | ~np.isfinite(scene.means).all(axis=1)
        if is_dead.all():
            return  # there is nothing to copy
        if is_dead.any():
            sources = np.arange(len(scene), dtype=np.int32)
            sources[is_dead] = rng.choice(np.flatnonzero(~is_dead), is_dead.sum(), p=_shares(scene.opacities[~is_dead]))
            engine.change_rows(self._sharing(scene, sources))
            scene = engine.download()
        most = max(min(self._context.most, int((1.0 + self._relocation.growth) * len(scene))), len(scene))
        if most > len(scene):
            added = rng.choice(len(scene), most - len(scene), p=_shares(scene.opacities))
            sources = np.concatenate([np.arange(len(scene)), added]).astype(np.int32)
            engine.change_rows(self._sharing(scene, sources))

    def _sharing(self, scene: Gaussians, sources: np.ndarray) -> RowChange:
        """Copy rows, and divide opacity and size among the copies of each source."""
        sharing = np.bincount(sources, minlength=len(scene))
        rows = np.flatnonzero(sharing[sources] > 1).astype(np.int32)
        opacities, shrinking = compute_relocation(scene.opacities[sources[rows]], sharing[sources[rows]])
        opacities = np.clip(opacities, self._relocation.dead, MAX_OPACITY)
        fresh = np.zeros(len(sources), np.bool_)
        fresh[rows] = True
        log_scales = scene.log_scales[sources[rows]] + np.log(shrinking)[:, None].astype(np.float32)
        return RowChange(sources, fresh, {"opacity_logits": (rows, logit(opacities)), "log_scales": (rows, log_scales)})


def _shares(opacities: np.ndarray) -> np.ndarray:
    """Probabilities proportional to opacities."""
    weights = np.nan_to_num(opacities.astype(np.float64))
    return weights / weights.sum()
