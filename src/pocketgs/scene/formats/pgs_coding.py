"""The rounding of a `.pgs`: how fine the grid of each parameter is."""

from __future__ import annotations

from dataclasses import astuple, dataclass

import numpy as np

from pocketgs.scene.formats.spz_precision import Detail

FINER = 0.7
"""Steps of a grid relative to those of the next coarser one."""


@dataclass(frozen=True)
class Coding:
    """Steps of the grids that parameters are rounded to.

    Attributes:
        position: of centres, as a share of each Gaussian's size, the middle one of its standard deviations; rounded
            down to a power of two in scene units.
        log_scale: of the natural logarithms of standard deviations.
        rotation: of rotations, in halves of a radian, where the standard deviations differ by a factor of about 2.
        opacity: of opacity logits.
        colour: of coefficients of degree 0.
        harmonics: of coefficients above degree 0, in the codebook.
        entries: of that codebook, at most. 0 for none: every coefficient is rounded.
        per_entry: Gaussians for each of its entries, at least; small scenes have fewer entries.
    """

    position: float = 0.25
    log_scale: float = 0.2
    rotation: float = 1 / 8
    opacity: float = 0.3
    colour: float = 0.1
    harmonics: float = 1 / 32
    entries: int = 8192
    per_entry: int = 12

    @property
    def rounds(self) -> str:
        """The largest rounding errors, as text."""
        harmonics = f"to {self.entries:,} vectors" if self.entries else f"to {self.harmonics / 2:.2g}"
        return (
            f"centres to {self.position / 2:.2g} of a Gaussian's size, log scales to {self.log_scale / 2:.2g}, opacity "
            f"logits to {self.opacity / 2:.2g}, coefficients of degree 0 to {self.colour / 2:.2g}, higher spherical "
            f"harmonics {harmonics}, and rotations, those of round Gaussians less exactly"
        )

    def finer(self) -> Coding:
        """The next finer grids."""
        *steps, entries, per_entry = astuple(self)
        position, log_scale, rotation, opacity, colour, harmonics = (FINER * step for step in steps)
        return Coding(position, log_scale, rotation, opacity, colour, harmonics, entries, per_entry)

    def in_single_precision(self) -> Coding:
        """With the steps as the file holds them."""
        *steps, entries, per_entry = astuple(self)
        position, log_scale, rotation, opacity, colour, harmonics = (float(np.float32(step)) for step in steps)
        return Coding(position, log_scale, rotation, opacity, colour, harmonics, entries, per_entry)


DEFAULT = Coding()
FINE = Coding(0.125, 0.1, 1 / 16, 0.2, 0.07, 0.05, entries=0)
CODINGS: dict[Detail, Coding] = {"fine": FINE, "small": DEFAULT}
