"""Learning of colour transforms for the training photographs."""

from __future__ import annotations

from typing import Literal, get_args

from pocketgs.splat.settings import ColourSettings

Colours = Literal["on", "off"]

COLOURS = get_args(Colours)

RATE = 0.01
"""Adam's initial step size, for factors and display values: each photograph is visited only some ten times in a run."""

WEIGHT = 0.01
"""Weight of the squared difference from the identity, small enough not to outweigh the photographs."""


def colour_settings(share: float) -> ColourSettings:
    """Settings of an iteration whose rates are `share` of the initial ones."""
    return ColourSettings(RATE * share, WEIGHT)
