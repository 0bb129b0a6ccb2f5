"""Learned masks: training with random Gaussians left out finds those that a scene can do without.

MaskGaussian (Liu et al. 2025): each Gaussian is kept with a probability that is trained. Every step draws a sample of
them, by Gumbel noise. A left-out Gaussian still gets the gradient of being drawn, α T times the difference of its
colour from what is behind it: what it would add to the others, which its contribution α T alone does not tell.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pocketgs.compression.fine_tuning import FineTuner
from pocketgs.scene.gaussians import Gaussians
from pocketgs.splat.optimiser import Adam, photometric_loss
from pocketgs.splat.rasterizer import Rasterizer

FAINT = 0.01
"""Opacity at which left-out Gaussians are drawn, so that the rasterizer gives their gradients."""

CERTAIN = 15.0
"""Maximum magnitude of a logit of opacity: beyond it, an opacity is 0 or 1 to rounding, and has no gradient."""

FIRST_LOGIT = 2.0
"""Initial logit of the probability of being kept."""

RATE, BETA1, BETA2 = 0.1, 0.9, 0.95
"""Adam's rate of the logits, and its averages of their gradients."""

PRESSURE = 1.0
"""Weight of the squared excess of the kept share over the wanted one."""

SETTLED = 0.7
"""Share of the steps after which the wanted number is reached."""


def prune_by_masks(tuner: FineTuner, rasterizer: Rasterizer, scene: Gaussians, count: int, steps: int) -> Gaussians:
    """Train a scene together with masks of its Gaussians, and keep those that are most probable.

    Args:
        tuner: whose views, learning rates and loss are used.
        rasterizer: of any engine.
        scene: to prune.
        count: number of Gaussians to keep.
        steps: of training.
    """
    certain = replace(scene, opacity_logits=np.clip(scene.opacity_logits, -CERTAIN, CERTAIN))
    masks, adam = _Masks(len(scene)), Adam(certain, tuner.recipe.adam)
    for step in range(steps):
        frame, rates = tuner.next_frame(), tuner.rates_at(step, steps)
        kept = masks.sample()
        opacities = _sigmoid(np.clip(adam.scene.opacity_logits.astype(np.float64), -CERTAIN, CERTAIN))
        shown = np.where(kept, opacities, np.minimum(opacities, FAINT))
        drawn = replace(adam.scene, opacity_logits=np.log(shown / (1.0 - shown)).astype(np.float32))
        seen = rasterizer.forward(drawn, frame.camera, ("rgb",), background=tuner.background)
        assert seen.rgb is not None
        _, gradient = photometric_loss(seen.rgb, frame.image, tuner.recipe.loss, frame.mask)
        found = rasterizer.backward(seen, rgb=gradient)
        by_opacity = found.opacity_logits.astype(np.float64) / (shown * (1.0 - shown))
        wanted = 1.0 - (1.0 - count / len(scene)) * min((step + 1) / (SETTLED * steps), 1.0)
        masks.step(opacities * by_opacity, wanted)
        own = np.where(kept, by_opacity * opacities * (1.0 - opacities), 0.0).astype(np.float32)
        adam.step(replace(found, opacity_logits=own), rates)
        tuner.count_step()
    order = np.argsort(-masks.scores(), kind="stable")
    return adam.scene.select(np.sort(order[:count]))


class _Masks:
    """Probabilities of N Gaussians to be kept, and Adam's state for each."""

    def __init__(self, count: int) -> None:
        self._logits = np.full(count, FIRST_LOGIT)
        self._mean, self._square, self._steps = np.zeros((3, count))
        self._rng = np.random.default_rng(0)
        self._soft, self._kept = np.ones(count), np.ones(count, np.bool_)

    def scores(self) -> np.ndarray:
        """(N,) logits of the probabilities; minus infinity for Gaussians that no view has seen."""
        return np.where(self._steps > 0, self._logits, -np.inf)

    def sample(self) -> np.ndarray:
        """(N,) bool: the Gaussians kept in the next step."""
        noise = self._rng.logistic(size=len(self._logits))  # the difference of two Gumbel variables
        self._soft = _sigmoid(self._logits + noise)
        self._kept = self._soft > 0.5
        return self._kept

    def step(self, gradient: np.ndarray, wanted: float) -> None:
        """Take a step, straight through the sample to the logits.

        Args:
            gradient: (N,) of the loss with respect to the sample; 0 for Gaussians that the view does not see.
            wanted: share of the Gaussians to keep.
        """
        seen = gradient != 0
        pressure = 2.0 * PRESSURE * max(float(self._kept.mean()) - wanted, 0.0) / len(self._logits)
        slope = (gradient + pressure) * self._soft * (1.0 - self._soft)
        self._steps += seen
        self._mean = np.where(seen, BETA1 * self._mean + (1.0 - BETA1) * slope, self._mean)
        self._square = np.where(seen, BETA2 * self._square + (1.0 - BETA2) * slope**2, self._square)
        count = np.maximum(self._steps, 1.0)
        mean, square = self._mean / (1.0 - BETA1**count), self._square / (1.0 - BETA2**count)
        self._logits -= np.where(seen, RATE * mean / (np.sqrt(square) + 1e-15), 0.0)


def _sigmoid(values: np.ndarray) -> np.ndarray:
    return np.asarray(1.0 / (1.0 + np.exp(-values)))
