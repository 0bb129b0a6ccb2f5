"""Pruning: the least important Gaussians go in rounds, and the others learn to do without them in between."""

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
"""Share of the Gaussians that a round keeps: too few at once, and those that would have replaced each other go
together."""

LEAST = 32
"""Pruning ends with so many Gaussians at the latest."""


@dataclass(frozen=True)
class Pruner:
    """Prunes with these views.

    Attributes:
        tuner: trains in between.
        cameras: the views that count.
        measure: of importance.
        rasterizer: finds what each Gaussian contributes.
    """

    tuner: FineTuner
    cameras: Sequence[Camera]
    measure: Importance
    rasterizer: Rasterizer

    def down_to(self, scene: Gaussians, count: int) -> Gaussians:
        """The most important Gaussians, in their order."""
        if count >= len(scene):
            return scene
        order = np.argsort(-importance(scene, self.cameras, self.rasterizer, self.measure), kind="stable")
        return scene.select(np.sort(order[:count]))

    def weights(self, scene: Gaussians) -> np.ndarray:
        """(N,) positive, how much errors of each Gaussian matter: square roots of what they contribute to the views."""
        summed, _ = contributions(scene, self.cameras, self.rasterizer)
        return np.asarray(np.sqrt(summed + 1e-6 * max(summed.max(), 1e-9)))

    def rounds(self, scene: Gaussians, steps: int) -> Iterator[Gaussians]:
        """The scene itself, and what is left of it after each round.

        Args:
            scene: to prune.
            steps: of training after each round.
        """
        yield scene
        while len(scene) * SHRINKS >= LEAST:
            scene = self.down_to(scene, int(len(scene) * SHRINKS))
            scene = self.tuner.tune(scene, steps)
            yield scene
