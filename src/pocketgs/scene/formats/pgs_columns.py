"""Writing and reading columns of a `.pgs` by one description of them: `code` returns what it is given or what it
reads.
"""

from __future__ import annotations

from pathlib import Path
from typing import Protocol

import numpy as np

from pocketgs.errors import PocketGSError
from pocketgs.scene.formats.range_coder import UNPREDICTED, RangeDecoder, RangeEncoder, new_models

MAX_NUMBER = 1 << 24
"""The largest magnitude of a number, and the largest count of Gaussians, whose parts the tree of positions codes."""


class Columns(Protocol):
    """Columns that are written or read."""

    def code(self, values: np.ndarray, contexts: np.ndarray, neighbours: np.ndarray = UNPREDICTED) -> np.ndarray:
        """Write or read the next column.

        Args:
            values: (N,) integers to write; a reader ignores them.
            contexts: (N,) non-negative integers: numbers of one context are expected to be alike.
            neighbours: (N, 2) indices of earlier rows of which the mean is expected, or none.

        Returns:
            (N,) int64, the values.
        """
        ...


class WrittenColumns:
    """Columns that go into a stream."""

    def __init__(self) -> None:
        self._coder = RangeEncoder()

    def code(self, values: np.ndarray, contexts: np.ndarray, neighbours: np.ndarray = UNPREDICTED) -> np.ndarray:
        """Write a column; as in `Columns`."""
        self._coder.column(values, contexts, new_models(int(contexts.max(initial=0)) + 1), neighbours)
        return values.astype(np.int64)

    def finish(self) -> bytes:
        """The stream."""
        return self._coder.finish()


class ReadColumns:
    """Columns that come from a stream.

    Args:
        path: the file, for messages.
        stream: bytes.
    """

    def __init__(self, path: Path, stream: bytes) -> None:
        self._path = path
        self._coder = RangeDecoder(stream)

    def code(self, values: np.ndarray, contexts: np.ndarray, neighbours: np.ndarray = UNPREDICTED) -> np.ndarray:
        """Read a column; as in `Columns`.

        Raises:
            PocketGSError: it holds numbers beyond all bounds.
        """
        models = new_models(int(contexts.max(initial=0)) + 1)
        found = self._coder.column(contexts, models, neighbours)
        if np.abs(found).max(initial=0) > MAX_NUMBER:
            raise PocketGSError(f"{self._path}: broken: holds a number beyond {MAX_NUMBER:,} steps")
        return found
