"""A scene that is drawn without sorting: Gaussians, and the inputs of their weights."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pocketgs.errors import PocketGSError
from pocketgs.scene.gaussians import SH_COEFFICIENTS, SH_DC, Gaussians
from pocketgs.sort_free.forms import Form, form_named

MAX_UNIT, MAX_LOGARITHM = 1e15, 20.0
"""Units of length, and logarithms of numbers, past these come from broken files only."""


@dataclass
class SortFreeScene:
    """Gaussians with the weights of one form.

    Attributes:
        gaussians: the Gaussians.
        form: how they are weighted.
        unit: length, in scene units, that distances and sizes are measured in.
        log_shared: (G,) float64 natural logarithms of the form's shared numbers, in their order.
        visibility_sh: (N, K) float32 spherical harmonics of v, K = 1, 4, 9 or 16; (N, 0) where the form has no v.
    """

    gaussians: Gaussians
    form: Form
    unit: float
    log_shared: np.ndarray
    visibility_sh: np.ndarray

    def __post_init__(self) -> None:
        count = len(self.gaussians.means)
        self.log_shared = np.asarray(self.log_shared, np.float64)
        if self.log_shared.shape != (len(self.form.numbers),):
            raise PocketGSError(f"sort-free scene: {self.log_shared.shape} numbers, expected {len(self.form.numbers)}")
        wanted = SH_COEFFICIENTS if self.form.view_start is not None else (0,)
        shape = self.visibility_sh.shape
        if len(shape) != 2 or shape[0] != count or shape[1] not in wanted:
            expected = " or ".join(map(str, wanted))
            raise PocketGSError(f"sort-free scene: views of shape {shape}, expected ({count}, {expected})")
        if not (1.0 / MAX_UNIT < self.unit < MAX_UNIT and np.all(np.abs(self.log_shared) < MAX_LOGARITHM)):
            found = f"unit {self.unit:g} and numbers {np.exp(self.log_shared)}"
            raise PocketGSError(f"sort-free scene: {found}, expected such that float32 can hold")

    def __len__(self) -> int:
        return len(self.gaussians.means)


def sort_free(gaussians: Gaussians, form: str, unit: float, view_degree: int = 1) -> SortFreeScene:
    """Make a scene whose weights have their initial values.

    Args:
        gaussians: to weigh.
        form: name of the form.
        unit: length that distances are measured in; a typical distance of the cameras from the scene.
        view_degree: of the spherical harmonics of v.

    Raises:
        PocketGSError: there is no such form.
    """
    chosen = form_named(form)
    coefficients = 0 if chosen.view_start is None else SH_COEFFICIENTS[view_degree]
    visibility_sh = np.zeros((len(gaussians), coefficients), np.float32)
    if chosen.view_start is not None:
        visibility_sh[:, 0] = chosen.view_start / SH_DC
    return SortFreeScene(gaussians, chosen, unit, np.log(list(chosen.numbers.values())), visibility_sh)
