"""Changes of the number of Gaussians, and the statistics that strategies base them on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields

import numpy as np

from pocketgs.errors import PocketGSError
from pocketgs.geometry.quaternions import of_unit_length
from pocketgs.splat.parameters import ParameterLayout


@dataclass(frozen=True)
class RowChange:
    """Removal, reordering and duplication of Gaussians in one operation, including the optimiser's rows.

    Attributes:
        sources: (M,) int32, current row that each of the M new rows copies, with parameters and moments.
        fresh: (M,) bool, rows whose moments are reset to zero.
        values: by parameter name (`means`, `log_scales`, `quaternions`, `opacity_logits`, `sh`), new rows (R,) of
            integers, each at most once, and the values (R, ...) to set, quaternions of any length. Moments of that
            parameter are reset there.
    """

    sources: np.ndarray
    fresh: np.ndarray
    values: Mapping[str, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)

    @staticmethod
    def of_values(count: int, values: Mapping[str, tuple[np.ndarray, np.ndarray]]) -> RowChange:
        """A change that keeps all `count` rows in place, and sets some values."""
        return RowChange(np.arange(count, dtype=np.int32), np.zeros(count, np.bool_), values)


@dataclass(frozen=True)
class Statistics:
    """Sums per Gaussian over the steps that collected them, since the last change of rows.

    Attributes:
        screen_gradients: (N,) float32, summed norm of the loss's gradient with respect to the 2D mean, in half the
            image's width and height as in 3DGS.
        seen: (N,) float32, number of steps whose view showed it: on the CPU, where its bounds on the image contain a
            pixel's centre; on a GPU, where its ellipse reaches a tile, which a few of these do not.
        radii: (N,) float32, maximum radius on an image, three standard deviations, relative to the longer side.
        errors: (N,) float32, summed α T |rendered - photograph| over the pixels of steps with `StepSettings.errors`,
            before their updates.
    """

    screen_gradients: np.ndarray
    seen: np.ndarray
    radii: np.ndarray
    errors: np.ndarray

    @staticmethod
    def none_yet(count: int) -> Statistics:
        """Zeros, before the first step."""
        return Statistics(*(np.zeros(count, np.float32) for _ in fields(Statistics)))


def checked_change(change: RowChange, count: int, layout: ParameterLayout) -> RowChange:
    """Check that a change fits the scene.

    Args:
        change: to check.
        count: current number of rows.
        layout: of the scene's parameters.

    Returns:
        The change with float32 values, and quaternions of unit length.

    Raises:
        PocketGSError: a row or parameter does not exist, or shapes disagree.
    """
    sources, fresh = np.asarray(change.sources), np.asarray(change.fresh)
    if sources.ndim != 1 or sources.dtype != np.int32:
        raise PocketGSError(f"change of rows: sources are {sources.dtype} {sources.shape}, expected int32 (M,)")
    if fresh.shape != sources.shape or fresh.dtype != np.bool_:
        raise PocketGSError(f"change of rows: fresh is {fresh.dtype} {fresh.shape}, expected bool {sources.shape}")
    _check_rows("sources", sources, count)
    checked = {}
    for name, (rows, values) in change.values.items():
        if name not in {group.name for group in layout.groups}:
            raise PocketGSError(f"change of rows: found values of {name!r}, which is not a parameter")
        listed, found = np.asarray(rows), np.asarray(values)
        if listed.ndim != 1 or (listed.size and listed.dtype.kind not in "iu"):
            found_rows = f"rows {listed.dtype} {listed.shape}"
            raise PocketGSError(f"change of rows: {name} are set in {found_rows}, expected integers (R,)")
        _check_rows(name, listed, len(sources))
        if len(np.unique(listed)) < len(listed):
            raise PocketGSError(f"change of rows: {name} names a row twice, expected each at most once")
        expected = (len(listed), *layout.group(name).tail(layout.coefficients))
        if found.shape != expected or found.dtype.kind not in "iuf":
            raise PocketGSError(f"change of rows: {name} are {found.dtype} {found.shape}, expected numbers {expected}")
        listed, numbers = listed.astype(np.int32, copy=False), found.astype(np.float32, copy=False)
        checked[name] = (listed, of_unit_length(numbers) if name == "quaternions" else numbers)
    return RowChange(sources, fresh, checked)


def _check_rows(what: str, rows: np.ndarray, count: int) -> None:
    if len(rows) and (rows.min() < 0 or rows.max() >= count):
        raise PocketGSError(
            f"change of rows: {what} name rows {rows.min()} to {rows.max()}, expected 0 to {count - 1} of {count}"
        )
