"""Rounding to what a file holds, group by group: what one group loses, the others learn to make up for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pocketgs.compression.fine_tuning import RATE, FineTuner
from pocketgs.scene.formats.codebooks import nearest, vector_codebook
from pocketgs.scene.formats.pgs_coding import Coding
from pocketgs.scene.formats.pgs_rounding import MAX_ENTRIES, distinct_rows, levels, on_grid, rounded
from pocketgs.scene.gaussians import Gaussians

ORDER = ("sh_rest", "log_scales", "quaternions", "means", "opacity_logits", "sh_dc")
"""What loses most goes first, so that most is left to make up for it. Grids of rotations and centres depend on rounded
scales."""

RATE_WHILE_ROUNDING = 0.4 * RATE
"""Learning rates, relative to training's: what is trained must not move far before it is rounded as well."""


def rounded_in_turn(scene: Gaussians, tuner: FineTuner, coding: Coding, steps: int, finely: bool) -> Gaussians:
    """The scene on the grids of a file.

    Harmonics are rounded to a codebook, whose entries are trained on with the other groups.

    Args:
        scene: to round.
        tuner: trains what is not rounded yet.
        coding: the grids.
        steps: of training after each group.
        finely: whether to round harmonics as `with_fine_harmonics` does.
    """
    scene = with_fine_harmonics(scene, coding) if finely else rounded(scene, coding, ORDER[:1])
    labels = distinct_rows(_harmonics(scene, coding))[1]
    for number in range(1, len(ORDER) + 1):
        frozen = ORDER[1:number]
        scene = tuner.tune(scene, steps, frozen, start=RATE_WHILE_ROUNDING, end=0.2 * RATE_WHILE_ROUNDING)
        scene = rounded(with_shared_harmonics(scene, labels, coding), coding, ORDER[number : number + 1])
    return rounded(scene, coding)


def _harmonics(scene: Gaussians, coding: Coding) -> np.ndarray:
    """(N, D) multiples of the grid's step."""
    return levels(scene.sh[:, 1:].reshape(len(scene), -1), coding.in_single_precision().harmonics)


def with_fine_harmonics(scene: Gaussians, coding: Coding) -> Gaussians:
    """Round harmonics to the grid alone, or, if that leaves more than a file can hold, to the largest codebook.

    Args:
        scene: to round.
        coding: the grids.
    """
    rows, step = scene.sh[:, 1:].reshape(len(scene), -1), coding.in_single_precision().harmonics
    near = on_grid(rows, step)
    if rows.size and len(distinct_rows(levels(rows, step))[0]) > MAX_ENTRIES:
        book = on_grid(vector_codebook(rows, MAX_ENTRIES, np.ones(len(rows))), step)
        near = book[nearest(rows, book)]
    sh = scene.sh.copy()
    sh[:, 1:] = near.reshape(sh[:, 1:].shape)
    return replace(scene, sh=sh)


def with_shared_harmonics(scene: Gaussians, labels: np.ndarray, coding: Coding) -> Gaussians:
    """Give Gaussians of the same label the mean of their harmonics, rounded: the entry of the codebook.

    Args:
        scene: with harmonics that have been trained one by one.
        labels: (N,) entries of the codebook.
        coding: the grids.
    """
    rows = scene.sh[:, 1:].reshape(len(scene), -1)
    if rows.size == 0:
        return scene
    sums = np.zeros((labels.max() + 1, rows.shape[1]))
    np.add.at(sums, labels, rows)
    entries = on_grid(sums / np.bincount(labels)[:, None], coding.in_single_precision().harmonics)
    sh = scene.sh.copy()
    sh[:, 1:] = entries[labels].reshape(sh[:, 1:].shape)
    return replace(scene, sh=sh)
