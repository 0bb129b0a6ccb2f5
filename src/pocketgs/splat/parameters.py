"""What a Gaussian is made of, stated once: columns, learning rates, checks and plans of memory are derived from it.

A parameter is held in one array, and trained in columns of the gradient and of Adam's two moments, which lie beside
each other in one row per Gaussian. Most are trained in as many columns as they have numbers; rotations are held as
quaternions of four numbers, and trained in the three of their tangent space.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import prod

import numpy as np

from pocketgs.splat.settings import LearningRates

COEFFICIENTS = -1
"""Stands for the number of spherical-harmonics coefficients in a shape."""

FLOAT_BYTES = 4


@dataclass(frozen=True)
class Group:
    """One parameter of every Gaussian.

    Attributes:
        name: of its array, as in `Gaussians`.
        shape: of one Gaussian's numbers; COEFFICIENTS stands for K.
        rates: fields of `LearningRates`, each with the number of columns that it holds for; None for the rest.
        trained: number of columns, where they are not as many as the numbers.
    """

    name: str
    shape: tuple[int, ...]
    rates: tuple[tuple[str, int | None], ...]
    trained: int | None = None

    def tail(self, coefficients: int) -> tuple[int, ...]:
        """Shape of one Gaussian's numbers, with K coefficients of spherical harmonics."""
        return tuple(coefficients if side == COEFFICIENTS else side for side in self.shape)

    def numbers(self, coefficients: int) -> int:
        """How many numbers a Gaussian holds."""
        return prod(self.tail(coefficients))

    def columns(self, coefficients: int) -> int:
        """How many columns they are trained in."""
        return self.numbers(coefficients) if self.trained is None else self.trained


# Those whose size varies come last, so that the others' columns are the same for every K.
GROUPS = (
    Group("means", (3,), (("means", None),)),
    Group("log_scales", (3,), (("log_scales", None),)),
    Group("quaternions", (4,), (("rotations", None),), trained=3),
    Group("opacity_logits", (), (("opacity_logits", None),)),
    Group("sh", (COEFFICIENTS, 3), (("sh_dc", 3), ("sh_rest", None))),
)


@dataclass(frozen=True)
class ParameterLayout:
    """Where everything lies in a Gaussian's rows.

    Attributes:
        coefficients: of spherical harmonics per channel, K.
        groups: the parameters, in the order of their columns.
    """

    coefficients: int
    groups: tuple[Group, ...] = GROUPS

    @property
    def columns(self) -> int:
        """Columns of a gradient, and of each of Adam's moments."""
        return sum(group.columns(self.coefficients) for group in self.groups)

    @property
    def numbers(self) -> int:
        """Numbers that a Gaussian holds."""
        return sum(group.numbers(self.coefficients) for group in self.groups)

    def group(self, name: str) -> Group:
        """The parameter of that name."""
        return next(group for group in self.groups if group.name == name)

    def columns_of(self, name: str) -> slice:
        """The columns that a parameter is trained in."""
        first = 0
        for group in self.groups:
            end = first + group.columns(self.coefficients)
            if group.name == name:
                return slice(first, end)
            first = end
        raise KeyError(name)

    def rates_by_column(self, rates: LearningRates) -> np.ndarray:
        """(columns,) float32: the learning rate of every column."""
        row = np.empty(self.columns, np.float32)
        for group in self.groups:
            columns = row[self.columns_of(group.name)]
            first = 0
            for name, count in group.rates:
                end = len(columns) if count is None else first + count
                columns[first:end] = getattr(rates, name)
                first = end
        return row


def first_column(name: str) -> int:
    """The first column of a parameter; the same for every number of coefficients."""
    return int(ParameterLayout(1).columns_of(name).start)
