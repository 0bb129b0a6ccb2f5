"""Fine-tuning: a few more training steps, optionally with some parameters frozen."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace

import numpy as np

from pocketgs.capture.capture import Frame
from pocketgs.scene.background import Background
from pocketgs.scene.gaussians import Gaussians
from pocketgs.splat.engine import Engine
from pocketgs.splat.settings import LearningRates, StepSettings
from pocketgs.training.recipes import recipe_named
from pocketgs.training.view_choice import view_of_step

RATE = 0.5
"""Learning rates at the start, relative to those at the start of training: the scene is close to its optimum."""

RATE_OF_GROUP = {
    "means": "means",
    "log_scales": "log_scales",
    "quaternions": "rotations",
    "opacity_logits": "opacity_logits",
    "sh_dc": "sh_dc",
    "sh_rest": "sh_rest",
}
"""The learning rate of each group of parameters that is rounded separately."""


class FineTuner:
    """Trains a scene further on views.

    Args:
        engine: to train with.
        frames: photographs, or renderings of the scene itself.
        background: behind the scene, RGB in [0, 1].
        scene: gives the unit of length, by its distance from the cameras.
        seed: of the order of views.
        after_step: called after every step.

    Attributes:
        rate: initial learning rates of fine-tuning, relative to those of training.
        recipe: of the loss and the optimiser.
        background: see above.
    """

    def __init__(
        self,
        engine: Engine,
        frames: Sequence[Frame],
        background: Background,
        scene: Gaussians,
        seed: int,
        after_step: Callable[[], None] = lambda: None,
    ) -> None:
        self.rate = RATE
        self.recipe = recipe_named("pocketgs")
        self.background = background
        self._engine, self._frames, self._after_step = engine, frames, after_step
        self._seed, self._taken = seed, 0
        cameras = [frame.camera for frame in frames]
        self._rates = self.recipe.rates_for_scene(self.recipe.scales_for or 1, cameras, scene)
        engine.set_views(frames)

    def tune(
        self,
        scene: Gaussians,
        steps: int,
        frozen: Collection[str] = (),
        *,
        start: float | None = None,
        end: float | None = None,
    ) -> Gaussians:
        """Train a scene for some steps.

        Args:
            scene: to start from.
            steps: number of steps.
            frozen: groups that stay unchanged, see RATE_OF_GROUP.
            start: initial learning rates, relative to those of training; None for `rate`.
            end: final learning rates, None for a tenth of the initial ones; they fall along a half cosine.
        """
        self._engine.upload(scene)
        for step in range(steps):
            rates = replace(self.rates_at(step, steps, start, end), **{RATE_OF_GROUP[group]: 0.0 for group in frozen})
            settings = StepSettings(rates, self.recipe.loss, self.recipe.adam, self.background)
            self._engine.step(self._next_view(), settings)
            self.count_step()
        return self._engine.download()

    def rates_at(self, step: int, steps: int, start: float | None = None, end: float | None = None) -> LearningRates:
        """Learning rates of a step; see `tune`."""
        start = self.rate if start is None else start
        end = 0.1 * start if end is None else end
        return self._rates.scaled(end + (start - end) * 0.5 * (1.0 + float(np.cos(np.pi * step / steps))))

    def next_frame(self) -> Frame:
        """The photograph to train on next."""
        return self._frames[self._next_view()]

    def count_step(self) -> None:
        """Count a step of training."""
        self._taken += 1
        self._after_step()

    def _next_view(self) -> int:
        return view_of_step(self._taken, len(self._frames), self._seed)
