"""Learning of colour transforms for the training photographs."""

from __future__ import annotations

from typing import Literal, get_args

from pocketgs.prior.report import PriorReport
from pocketgs.splat.settings import ColourSettings

Colours = Literal["auto", "on", "off"]

COLOURS = get_args(Colours)

RATE = 0.01
"""Adam's initial step size, for factors and display values: each photograph is visited only some ten times in a run."""

WEIGHT = 0.01
"""Weight of the squared difference from the identity, small enough not to outweigh the photographs."""


def learns_colours(asked: Colours, report: PriorReport | None) -> bool:
    """Whether a run learns a colour transform per training photograph.

    By default it does if similar views differ abruptly in exposure or white balance. The scene absorbs slow changes:
    renderings of a view look like the photographs taken near it.

    Args:
        asked: the user's option.
        report: of the prior, or None without one.
    """
    return asked == "on" or (asked == "auto" and report is not None and report.gains is not None)


def colour_settings(share: float) -> ColourSettings:
    """Settings of an iteration whose rates are `share` of the initial ones."""
    return ColourSettings(RATE * share, WEIGHT)
