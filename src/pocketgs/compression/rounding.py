"""Rounding to the values that a file stores, one group of parameters at a time; training of the others compensates."""

from __future__ import annotations

import numpy as np

from pocketgs.compression.fine_tuning import FineTuner
from pocketgs.scene.formats.pgs_coding import Coding
from pocketgs.scene.formats.pgs_rounding import rounded
from pocketgs.scene.gaussians import Gaussians

ORDER = ("sh_rest", "log_scales", "quaternions", "means", "opacity_logits", "sh_dc")
"""Groups with the largest loss come first, so that most others can compensate. Grids of rotations and centres depend on
rounded scales."""

START, END = 0.1, 0.02
"""Learning rates relative to those of training: parameters must not move far before they are rounded too."""


def rounded_in_turn(
    scene: Gaussians, tuner: FineTuner, coding: Coding, steps: int, weights: np.ndarray | None = None
) -> Gaussians:
    """Round a scene to the grids of a file.

    Args:
        scene: to round.
        tuner: trains the groups that are not rounded yet.
        coding: the grids.
        steps: training steps after each group but the last.
        weights: (N,) positive weights of the Gaussians in the codebook of harmonics; None for the file format's own.
    """
    for number, group in enumerate(ORDER, start=1):
        scene = rounded(scene, coding, [group], weights)
        if number < len(ORDER):
            scene = tuner.tune(scene, steps, ORDER[:number], start=START, end=END)
    return rounded(scene, coding)
