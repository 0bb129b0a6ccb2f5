"""How fast the colours of the training photographs are learned beside the scene."""

from __future__ import annotations

from typing import Literal, get_args

from pocketgs.splat.settings import ColourSettings

Colours = Literal["on", "off"]

COLOURS = get_args(Colours)

RATE = 0.01
"""Adam's first step sizes, in factors and display values: a photograph comes up only some ten times in a run."""

WEIGHT = 0.01
"""Of the squared difference from the identity: what a photograph tells outweighs it, what it does not tell goes."""


def colour_settings(share: float) -> ColourSettings:
    """Of an iteration whose rates are `share` of the initial ones."""
    return ColourSettings(RATE * share, WEIGHT)
