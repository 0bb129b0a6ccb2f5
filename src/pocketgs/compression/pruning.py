"""Pruning: the least important Gaussians are removed in rounds, with training in between to compensate."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from pocketgs.compression.fine_tuning import FineTuner
from pocketgs.compression.importance import contributions, importance
from pocketgs.compression.masks import prune_by_masks
from pocketgs.geometry.camera import Camera
from pocketgs.scene.gaussians import Gaussians
from pocketgs.splat.rasterizer import Rasterizer

Pruning = Literal["contribution", "distinct", "masks"]

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
        method: which Gaussians go: the least important ones, see `importance`, or those that training with masks finds
            dispensable.
        rasterizer: computes contributions, and trains masks.
    """

    tuner: FineTuner
    cameras: Sequence[Camera]
    method: Pruning
    rasterizer: Rasterizer

    def down_to(self, scene: Gaussians, count: int) -> Gaussians:
        """The `count` most important Gaussians, in their order."""
        if count >= len(scene):
            return scene
        measure = "contribution" if self.method == "masks" else self.method
        order = np.argsort(-importance(scene, self.cameras, self.rasterizer, measure), kind="stable")
        return scene.select(np.sort(order[:count]))

    def trains_masks(self, steps: int) -> bool:
        """Whether `at_once` trains masks: with fewer steps than views, what some views show would look dispensable."""
        return self.method == "masks" and steps >= len(self.cameras)

    def at_once(self, scene: Gaussians, count: int, steps: int) -> Gaussians:
        """`count` Gaussians of a scene, chosen without training, or by masks.

        Args:
            scene: to prune.
            count: number of Gaussians to keep.
            steps: of training masks.
        """
        if self.trains_masks(steps) and count < len(scene):
            return prune_by_masks(self.tuner, self.rasterizer, scene, count, steps)
        return self.down_to(scene, count)

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
