"""Adam for what a sort-free scene has besides its Gaussians."""

from __future__ import annotations

import numpy as np

from pocketgs.splat.settings import AdamSettings


class ArrayAdam:
    """Adam on one array, in place (Kingma and Ba 2015, algorithm 1).

    Args:
        values: (N, …) to move.
        settings: how gradients are averaged; with `seen_only`, rows whose gradient is 0 keep values and moments.
    """

    def __init__(self, values: np.ndarray, settings: AdamSettings) -> None:
        self._values, self._settings, self._steps = values, settings, 0
        self._first, self._second = np.zeros_like(values), np.zeros_like(values)

    def step(self, gradient: np.ndarray, rate: float) -> None:
        """Take one step against the gradient."""
        if not self._values.size:
            return
        settings, rows = self._settings, np.ones(len(gradient), bool)
        if settings.seen_only:
            rows = np.any(gradient.reshape(len(gradient), -1) != 0.0, axis=1)
        self._steps += 1
        seen = gradient[rows]
        first = settings.beta1 * self._first[rows] + (1.0 - settings.beta1) * seen
        second = settings.beta2 * self._second[rows] + (1.0 - settings.beta2) * seen * seen
        self._first[rows], self._second[rows] = first, second
        ahead = first / (1.0 - settings.beta1**self._steps)
        size = np.sqrt(second / (1.0 - settings.beta2**self._steps)) + settings.epsilon
        self._values[rows] -= rate * ahead / size
