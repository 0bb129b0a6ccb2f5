"""Rounding to the values that a file stores, one group of parameters at a time; training of the others compensates."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pocketgs.compression.fine_tuning import RATE, FineTuner
from pocketgs.scene.formats.pgs_coding import Coding
from pocketgs.scene.formats.pgs_rounding import distinct_rows, levels, on_grid, rounded
from pocketgs.scene.gaussians import Gaussians

ORDER = ("sh_rest", "log_scales", "quaternions", "means", "opacity_logits", "sh_dc")
"""Groups with the largest loss come first, so that most others can compensate. Grids of rotations and centres depend on
rounded scales."""

START, END = 0.2, 0.04
"""Learning rates relative to those of fine-tuning: parameters must not move far before they are rounded too."""

BOOK_ROUNDS = 10
"""Times that the Gaussians of an entry of the codebook are trained apart and brought together again."""

BOOK_SHARE = 1 / 3
"""Training steps of each of these times, relative to those after a group."""


def steps_of_rounding(steps: int) -> int:
    """Maximum number of training steps that `rounded_in_turn` takes, given those after each group."""
    return (len(ORDER) - 1) * steps + BOOK_ROUNDS * round(BOOK_SHARE * steps)


def rounded_in_turn(
    scene: Gaussians, tuner: FineTuner, coding: Coding, steps: int, weights: np.ndarray, rate: float = RATE
) -> Gaussians:
    """Round a scene to the grids of a file.

    Args:
        scene: to round.
        tuner: trains the groups that are not rounded yet.
        coding: the grids.
        steps: training steps after each group but the last.
        weights: (N,) positive weights of the Gaussians in the codebook of harmonics.
        rate: initial learning rates of fine-tuning, relative to those of training.
    """
    for number, group in enumerate(ORDER, start=1):
        scene = rounded(scene, coding, [group], weights)
        if group == "sh_rest" and coding.entries and scene.sh_degree > 0:
            scene = _with_trained_codebook(scene, tuner, coding, round(BOOK_SHARE * steps), weights, START * rate)
        if number < len(ORDER):
            scene = tuner.tune(scene, steps, ORDER[:number], start=START * rate, end=END * rate)
    return rounded(scene, coding)


def _with_trained_codebook(
    scene: Gaussians, tuner: FineTuner, coding: Coding, steps: int, weights: np.ndarray, rate: float
) -> Gaussians:
    """Train the entries of the codebook together with all other parameters.

    Gaussians keep their entries (Niedermayr et al. 2024, "Compressed 3D Gaussian Splatting", train them too). They are
    trained apart for some steps, and the mean of an entry's Gaussians is the entry from then on.
    """
    _, labels = distinct_rows(levels(_harmonics(scene), coding.harmonics))
    mass = np.bincount(labels, weights)
    for _ in range(BOOK_ROUNDS):
        scene = tuner.tune(scene, steps, start=rate, end=rate)
        sums = [np.bincount(labels, weights * column) for column in _harmonics(scene).T]
        book = np.stack(sums, axis=1) / mass[:, None]
        scene = _with_harmonics(scene, book[labels])
    return _with_harmonics(scene, on_grid(_harmonics(scene), coding.harmonics))


def _harmonics(scene: Gaussians) -> np.ndarray:
    """(N, 3 (K - 1)) coefficients above degree 0."""
    return scene.sh[:, 1:].reshape(len(scene), -1)


def _with_harmonics(scene: Gaussians, rows: np.ndarray) -> Gaussians:
    sh = scene.sh.copy()
    sh[:, 1:] = rows.reshape(sh[:, 1:].shape)
    return replace(scene, sh=sh)
