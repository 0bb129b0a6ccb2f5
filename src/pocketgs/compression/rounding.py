"""Rounding to what a file holds, group by group: what one group loses, the others learn to make up for."""

from __future__ import annotations

from pocketgs.compression.fine_tuning import RATE, FineTuner
from pocketgs.scene.formats.pgs_coding import Coding
from pocketgs.scene.formats.pgs_rounding import rounded
from pocketgs.scene.gaussians import Gaussians

ORDER = ("log_scales", "quaternions", "means", "opacity_logits", "sh_rest", "sh_dc")
"""Shape first: colours make up for most of what it loses. Grids of rotations and centres depend on rounded scales."""

RATE_WHILE_ROUNDING = 0.4 * RATE
"""Learning rates, relative to training's: what is trained must not move far before it is rounded as well."""


def rounded_in_turn(scene: Gaussians, tuner: FineTuner, coding: Coding, steps: int) -> Gaussians:
    """The scene on the grids of a file.

    Args:
        scene: to round.
        tuner: trains what is not rounded yet.
        coding: the grids.
        steps: of training after each group.
    """
    for number, group in enumerate(ORDER, start=1):
        scene = rounded(scene, coding, [group])
        if number < len(ORDER):
            scene = tuner.tune(
                scene, steps, frozen=ORDER[:number], start=RATE_WHILE_ROUNDING, end=0.2 * RATE_WHILE_ROUNDING
            )
    return rounded(scene, coding)
