"""Whether and how fast the colours of the training photographs are learned beside the scene."""

from __future__ import annotations

from typing import Literal, get_args

from pocketgs.prior.report import PriorReport
from pocketgs.splat.settings import ColourSettings

Colours = Literal["auto", "on", "off"]

COLOURS = get_args(Colours)

RATE = 0.01
"""Adam's first step sizes, in factors and display values: a photograph comes up only some ten times in a run."""

WEIGHT = 0.01
"""Of the squared difference from the identity: what a photograph tells outweighs it, what it does not tell goes."""


def learns_colours(asked: Colours, report: PriorReport | None) -> bool:
    """Whether a run learns a colour transform for each training photograph.

    Left to itself it does where similar views were found to differ in exposure or white balance by jumps. Slow changes
    are a part of the scene: what is rendered for a view looks like the photographs taken near it.

    Args:
        asked: the user's wish.
        report: what the prior has found, or None if there was none.
    """
    return asked == "on" or (asked == "auto" and report is not None and report.gains is not None)


def colour_settings(share: float) -> ColourSettings:
    """Of an iteration whose rates are `share` of the initial ones."""
    return ColourSettings(RATE * share, WEIGHT)
