"""Rounding of a `.spz`: readers accept any values, and repeated ones compress well."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

Detail: TypeAlias = Literal["fine", "small"]


@dataclass(frozen=True)
class Precision:
    """The rounding of each number, in units of the format's own steps.

    Attributes:
        steps_in_size: minimum number of coordinate steps in the middle standard deviation of nine in ten Gaussians, or
            None for the finest steps that fit into 24 bits.
        opacity: in 1/255.
        colour: in 1/38.25 of the coefficient of degree 0.
        log_scale: in 1/16.
        rotation: in 1/511 of √½.
        harmonics: in 1/128, above degree 0.
        rearranged: whether Gaussians may be reordered and their axes renamed.
        drops: what is lost, as text.
        rounds: the largest errors of the rest, as text.
    """

    steps_in_size: float | None
    opacity: int
    colour: int
    log_scale: int
    rotation: int
    harmonics: int
    rearranged: bool
    drops: str
    rounds: str


FINE = Precision(
    steps_in_size=None,
    opacity=1,
    colour=1,
    log_scale=1,
    rotation=1,
    harmonics=1,
    rearranged=False,
    drops="",
    rounds="centres to 2^-23 of the largest coordinate, log scales to 1/32 within -10 to 5.9, opacity to 1/500, "
    "colours to 1/250 within -0.4 to 1.4, rotation to 0.3 degrees, spherical harmonics within -1 to 1 to 0.008",
)
"""Nearly the full precision of the format; its reference implementation rounds harmonics more coarsely."""

SMALL = Precision(
    steps_in_size=4.0,
    opacity=8,
    colour=4,
    log_scale=2,
    rotation=16,
    harmonics=4,
    rearranged=True,
    drops="the order of Gaussians or of their axes",
    rounds="centres to 1/8 of the size of nine in ten Gaussians, log scales to 1/16 within -10 to 5.9, opacity to "
    "1/63, colours to 1/67 within -0.4 to 1.4, rotation to 3 degrees, spherical harmonics within -1 to 1 to 0.02",
)
"""Chosen so that the next byte of every attribute lowers image error equally; see docs/formats.md."""

PRECISIONS: dict[Detail, Precision] = {"fine": FINE, "small": SMALL}
