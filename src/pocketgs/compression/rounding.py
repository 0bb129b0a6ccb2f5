"""Rounding to what a file holds, group by group: what one group loses, the others learn to make up for."""

from __future__ import annotations

import numpy as np

from pocketgs.compression.fine_tuning import FineTuner
from pocketgs.scene.formats.pgs_coding import Coding
from pocketgs.scene.formats.pgs_rounding import rounded
from pocketgs.scene.gaussians import Gaussians

ORDER = ("sh_rest", "log_scales", "quaternions", "means", "opacity_logits", "sh_dc")
"""What loses most goes first, so that most is left to make up for it. Grids of rotations and centres depend on rounded
scales."""

START, END = 0.1, 0.02
"""Learning rates relative to training's: what is trained must not move far before it is rounded as well."""


def rounded_in_turn(
    scene: Gaussians, tuner: FineTuner, coding: Coding, steps: int, weights: np.ndarray | None = None
) -> Gaussians:
    """The scene on the grids of a file.

    Args:
        scene: to round.
        tuner: trains what is not rounded yet.
        coding: the grids.
        steps: of training after each group but the last.
        weights: (N,) positive, of the Gaussians in the codebook of harmonics; None for the file format's own.
    """
    for number, group in enumerate(ORDER, start=1):
        scene = rounded(scene, coding, [group], weights)
        if number < len(ORDER):
            scene = tuner.tune(scene, steps, ORDER[:number], start=START, end=END)
    return rounded(scene, coding)
