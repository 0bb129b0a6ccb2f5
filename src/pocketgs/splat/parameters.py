"""The parameters of a Gaussian, defined once: columns, learning rates, checks and memory plans are derived from it.

Each parameter is an array. It is trained in columns of the gradient and of Adam's two moments, one row per Gaussian.
Most parameters have one column per number; rotations are stored as quaternions of four numbers, and trained in the
three columns of their tangent space.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import prod

import numpy as np

from pocketgs.splat.settings import LearningRates

COEFFICIENTS = -1
"""Placeholder for the number of spherical-harmonics coefficients in a shape."""

FLOAT_BYTES = 4


@dataclass(frozen=True)
class Group:
    """One parameter of every Gaussian.

    Attributes:
        name: of its array, as in `Gaussians`.
        shape: per Gaussian; COEFFICIENTS stands for K.
        rates: fields of `LearningRates`, each with the number of columns that it applies to; None for the rest.
        trained: number of columns, if it differs from the number of numbers.
    """

    name: str
    shape: tuple[int, ...]
    rates: tuple[tuple[str, int | None], ...]
    trained: int | None = None

    def tail(self, coefficients: int) -> tuple[int, ...]:
        """Shape per Gaussian, with K coefficients of spherical harmonics."""
        return tuple(coefficients if side == COEFFICIENTS else side for side in self.shape)

    def numbers(self, coefficients: int) -> int:
        """Number of numbers per Gaussian."""
        return prod(self.tail(coefficients))

    def columns(self, coefficients: int) -> int:
        """Number of columns per Gaussian."""
        return self.numbers(coefficients) if self.trained is None else self.trained


# Groups of variable size come last, so that the others' columns are the same for every K.
GROUPS = (
    Group("means", (3,), (("means", None),)),
    Group("log_scales", (3,), (("log_scales", None),)),
    Group("quaternions", (4,), (("rotations", None),), trained=3),
    Group("opacity_logits", (), (("opacity_logits", None),)),
    Group("sh", (COEFFICIENTS, 3), (("sh_dc", 3), ("sh_rest", None))),
)


@dataclass(frozen=True)
class ParameterLayout:
    """The columns of all parameters.

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
        """Number of numbers per Gaussian."""
        return sum(group.numbers(self.coefficients) for group in self.groups)

    def group(self, name: str) -> Group:
        """The parameter with this name."""
        return next(group for group in self.groups if group.name == name)

    def columns_of(self, name: str) -> slice:
        """The columns of a parameter."""
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
    """First column of a parameter, which does not depend on the number of coefficients."""
    return int(ParameterLayout(1).columns_of(name).start)
