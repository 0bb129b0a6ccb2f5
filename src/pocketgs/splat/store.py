"""The parameter store: Gaussians in growable arrays, with the optimiser's rows."""

from __future__ import annotations

import math

import numpy as np

from pocketgs.errors import PocketGSError
from pocketgs.scene.gaussians import Gaussians
from pocketgs.splat.engine import OptimiserState
from pocketgs.splat.parameters import ParameterLayout
from pocketgs.splat.rows import RowChange, checked_change

GROWTH = 1.5
"""Factor by which the capacity grows. Unused memory costs nothing."""


class ParameterStore:
    """Arrays of `capacity` rows, of which the first `count` are Gaussians.

    All arrays are returned as views, which a change of rows invalidates.

    Args:
        gaussians: initial scene; copied, with normalised quaternions.
        state: the optimiser's moments, copied, or None for zeros.
    """

    def __init__(self, gaussians: Gaussians, state: OptimiserState | None = None) -> None:
        self.layout = ParameterLayout(gaussians.sh.shape[1])
        self.count = self.capacity = len(gaussians)
        self._arrays = {group.name: getattr(gaussians, group.name).copy() for group in self.layout.groups}
        self._arrays["quaternions"][:] = gaussians.unit_quaternions
        shape = (self.count, self.layout.columns)
        self._first_moments = np.zeros(shape, np.float32) if state is None else state.first_moments.copy()
        self._second_moments = np.zeros(shape, np.float32) if state is None else state.second_moments.copy()
        self._gradients = np.zeros(shape, np.float32)

    def __getitem__(self, name: str) -> np.ndarray:
        """(N, ...) float32: the parameter with this name."""
        return self._arrays[name][: self.count]

    @property
    def scene(self) -> Gaussians:
        """The Gaussians, not copied."""
        return Gaussians(*(self[group.name] for group in self.layout.groups))

    @property
    def first_moments(self) -> np.ndarray:
        """(N, columns) float32."""
        return self._first_moments[: self.count]

    @property
    def second_moments(self) -> np.ndarray:
        """(N, columns) float32."""
        return self._second_moments[: self.count]

    @property
    def gradients(self) -> np.ndarray:
        """(N, columns) float32, scratch space of a step; not preserved between steps."""
        return self._gradients[: self.count]

    def nbytes(self) -> dict[str, int]:
        """Bytes by purpose."""
        return {
            "scene": sum(array.nbytes for array in self._arrays.values()),
            "moments": self._first_moments.nbytes + self._second_moments.nbytes,
            "gradients": self._gradients.nbytes,
        }

    def change_rows(self, change: RowChange) -> None:
        """Select, duplicate and set rows, including the optimiser's.

        Raises:
            PocketGSError: the change does not fit the scene, or memory; nothing is changed.
        """
        change = checked_change(change, self.count, self.layout)
        if len(change.sources) > self.capacity:
            self._make_room(max(len(change.sources), int(GROWTH * self.capacity)))
        for array in (*self._arrays.values(), self._first_moments, self._second_moments):
            self._gather(array, change.sources)
        self.count = len(change.sources)
        for moments in (self.first_moments, self.second_moments):
            moments[change.fresh] = 0.0
            for name, (rows, _) in change.values.items():
                moments[rows, self.layout.columns_of(name)] = 0.0
        for name, (rows, values) in change.values.items():
            self[name][rows] = values

    def _gather(self, array: np.ndarray, sources: np.ndarray) -> None:
        """Copy the source rows to the first ones, using the gradients' memory, which is free between steps."""
        rows = array.reshape(len(array), math.prod(array.shape[1:]))
        size = len(sources) * rows.shape[1]
        gathered = self._gradients.reshape(-1)[:size].reshape(len(sources), rows.shape[1])
        np.take(rows, sources, axis=0, out=gathered, mode="clip")  # indices are checked; "raise" would buffer
        rows[: len(sources)] = gathered

    def _make_room(self, capacity: int) -> None:
        """Grow the arrays to `capacity` rows, one after the other, so that only one is in memory twice.

        If one does not fit, those before it have room that is not used: the store is as it was.
        """
        try:
            self._gradients = np.empty((capacity, self.layout.columns), np.float32)
            for name, array in self._arrays.items():
                self._arrays[name] = _enlarged(array, capacity)
            self._first_moments = _enlarged(self._first_moments, capacity)
            self._second_moments = _enlarged(self._second_moments, capacity)
        except MemoryError as error:
            raise PocketGSError(f"{capacity:,} Gaussians do not fit into memory: {error}") from error
        self.capacity = capacity


def _enlarged(array: np.ndarray, rows: int) -> np.ndarray:
    if len(array) >= rows:
        return array
    larger = np.empty((rows, *array.shape[1:]), np.float32)
    larger[: len(array)] = array
    return larger
