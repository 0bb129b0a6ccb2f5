"""The searches of a compression: for the smallest file of sufficient quality, or the best one of at most a size."""

from __future__ import annotations

import numpy as np

from pocketgs.compression.candidates import Workshop
from pocketgs.compression.pruning import LEAST
from pocketgs.compression.search import Goal, search
from pocketgs.scene.formats.pgs_coding import DEFAULT, FINE, Coding
from pocketgs.scene.gaussians import Gaussians

BYTES_PER_GAUSSIAN = 11
"""Approximate size of a file; the search for a size starts from it."""

RECOVERS = 0.8
"""Approximate gain in dB of a candidate over the round of pruning that it starts from."""

SLACK = 1.6
"""dB below the bound at which pruning in rounds ends."""

DB_PER_FACTOR = 1.0
"""Approximate gain in dB when the number of Gaussians grows by a factor of e."""

PSNR_TOLERANCE, SIZE_TOLERANCE = 0.04, 0.04
"""Distances from the bound at which the search ends: dB of quality, or logarithm of the size."""

FEWER = 0.8
"""Number of Gaussians of the next candidate, relative to the number that would fit if size were proportional to it."""

GRIDS = 5
"""Number of grids to choose from for rounding alone."""

MAKES_UP = 0.5
"""Approximate loss by rounding, in dB, that training on renderings recovers."""


def search_by_size(scene: Gaussians, workshop: Workshop, size: float) -> None:
    """Make candidates of about so many bytes; at least one is within the bound, unless LEAST Gaussians take more.

    Args:
        scene: the original.
        workshop: makes and keeps the candidates.
        size: bound in bytes.
    """
    whole = workshop.only_rounded(scene, FINE)  # if this fits, little is better
    guess = max(int(size / BYTES_PER_GAUSSIAN), LEAST)
    workshop.prune(scene, lambda level: len(level.scene) > guess)
    _search_by_size(scene, workshop, size, guess)
    largest = max(len(each.contents) for each in workshop.candidates if each is not whole)
    if len(whole.contents) > size and largest < np.exp(-SIZE_TOLERANCE) * size and not workshop.timekeeper.is_up():
        # All Gaussians with a codebook take less: some of them on fine grids may be better.
        workshop.coding = FINE
        _search_by_size(scene, workshop, size, int(len(scene) * size / len(whole.contents)))
    # The size of small files shrinks less than in proportion to the number of Gaussians, which the search assumes.
    fewest = min(workshop.candidates, key=lambda each: len(each.contents))
    while len(fewest.contents) > size and fewest.count > LEAST:
        fewer = FEWER * fewest.count * size / len(fewest.contents)
        fewest = workshop.make(max(int(fewer), LEAST))


def _search_by_size(scene: Gaussians, workshop: Workshop, size: float, guess: int) -> None:
    goal = Goal(float(np.log(size)), 1.0, SIZE_TOLERANCE, from_above=False)
    is_time_up = workshop.timekeeper.is_up
    search(lambda count: float(np.log(len(workshop.make(count).contents))), goal, guess, LEAST, len(scene), is_time_up)


def search_on_photographs(scene: Gaussians, workshop: Workshop, bound: float) -> None:
    """Make candidates of about a quality, by training on photographs: with a codebook of harmonics, or if that is not
    good enough with any number of Gaussians, on fine grids.

    Args:
        scene: the original.
        workshop: makes and keeps the candidates.
        bound: minimum PSNR in dB.
    """
    guess = _prune_below(scene, workshop, bound)
    for coding in (DEFAULT, FINE):
        workshop.coding = coding
        _search_by_quality(scene, workshop, bound, guess)
        if any(map(workshop.is_within, workshop.candidates)):
            return
        if workshop.timekeeper.is_up():
            break
    _round_only(scene, workshop, bound)


def search_on_renderings(scene: Gaussians, workshop: Workshop, bound: float) -> None:
    """Make candidates of about a quality, by training on renderings of the scene; arguments as above."""
    workshop.coding = _round_only(scene, workshop, bound)
    _search_by_quality(scene, workshop, bound, _prune_below(scene, workshop, bound))


def _prune_below(scene: Gaussians, workshop: Workshop, bound: float) -> int:
    """Prune until the scene is clearly below the bound; returns the number of Gaussians that may be enough."""
    workshop.prune(scene, lambda level: level.psnr > bound - SLACK)
    good = [len(level.scene) for level in workshop.levels if level.psnr >= bound - RECOVERS]
    return min(good, default=len(scene))


def _search_by_quality(scene: Gaussians, workshop: Workshop, bound: float, guess: int) -> None:
    goal = Goal(bound, DB_PER_FACTOR, PSNR_TOLERANCE, from_above=True)
    search(lambda count: workshop.make(count).psnr, goal, guess, LEAST, len(scene), workshop.timekeeper.is_up)


def _round_only(scene: Gaussians, workshop: Workshop, bound: float) -> Coding:
    """Make candidates of the whole scene on finer and finer grids until one is within the bound.

    Returns:
        The coarsest of these grids that training may bring within the bound.
    """
    coding, chosen = FINE, None
    for _ in range(GRIDS):
        psnr = workshop.only_rounded(scene, coding).psnr
        if chosen is None and psnr >= bound - MAKES_UP:
            chosen = coding
        if psnr >= bound:
            break
        coding = coding.finer()
    return chosen or coding
