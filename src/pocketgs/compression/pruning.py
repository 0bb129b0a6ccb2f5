"""Pruning: the least important Gaussians are removed in rounds, with training in between to compensate."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from pocketgs.compression.fine_tuning import FineTuner
from pocketgs.compression.importance import Importance, contributions, importance
from pocketgs.geometry.camera import Camera
from pocketgs.scene.gaussians import Gaussians
from pocketgs.splat.rasterizer import Rasterizer

SHRINKS = 0.8
"""Share of the Gaussians that a round keeps: if too many are removed at once, Gaussians that could replace each other
go together."""

LEAST = 32
"""Minimum number of Gaussians; pruning ends there."""


@dataclass(frozen=True)
class Pruner:
    """Prunes scenes.

    Attributes:
        tuner: trains in between.
        cameras: the views that determine importance.
        measure: of importance.
        rasterizer: computes the Gaussians' contributions.
    """

    tuner: FineTuner
    cameras: Sequence[Camera]
    measure: Importance
    rasterizer: Rasterizer

    def down_to(self, scene: Gaussians, count: int) -> Gaussians:
        """The `count` most important Gaussians, in their order."""
        if count >= len(scene):
            return scene
        order = np.argsort(-importance(scene, self.cameras, self.rasterizer, self.measure), kind="stable")
        return scene.select(np.sort(order[:count]))

    def weights(self, scene: Gaussians) -> np.ndarray:
        """(N,) positive weights of the Gaussians' errors: square roots of their contributions to the views."""
        summed, _ = contributions(scene, self.cameras, self.rasterizer)
        return np.asarray(np.sqrt(summed + 1e-6 * max(summed.max(), 1e-9)))

    def rounds(self, scene: Gaussians, steps: int) -> Iterator[Gaussians]:
        """The scene itself, and the scene after each round.

        Args:
            scene: to prune.
            steps: of training after each round.
        """
        yield scene
        while len(scene) * SHRINKS >= LEAST:
            scene = self.down_to(scene, int(len(scene) * SHRINKS))
            scene = self.tuner.tune(scene, steps)
            yield scene
