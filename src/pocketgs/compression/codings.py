"""Codings to choose from: how finely a `.pgs` rounds."""

from __future__ import annotations

from dataclasses import replace

from pocketgs.scene.formats.pgs_coding import DEFAULT, FINE, Coding
from pocketgs.scene.formats.pgs_rounding import MAX_ENTRIES

FINER = 0.7
"""Steps of a grid relative to those of the next coarser one."""


def finer(coding: Coding) -> Coding:
    """The next finer grids."""
    names = ("position", "log_scale", "rotation", "opacity", "colour", "harmonics")
    return replace(coding, **{name: FINER * getattr(coding, name) for name in names})


LARGE = replace(DEFAULT, entries=MAX_ENTRIES, per_entry=6)

COARSE = Coding(position=0.125, log_scale=0.2, rotation=1 / 8, opacity=0.3, colour=0.1, harmonics=0.15, entries=0)

CODINGS = (DEFAULT, LARGE, COARSE, finer(COARSE), FINE)
"""Smallest file first. The first two have a codebook of harmonics, the others a grid."""
