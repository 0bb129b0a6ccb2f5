"""Removing, keeping and copying rows of the scene and of the optimiser on the GPU."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from pocketgs.gpu.executor import Executor
from pocketgs.gpu.sizes import Symbols
from pocketgs.splat.parameters import ParameterLayout
from pocketgs.splat.rows import RowChange
from pocketgs.splat.webgpu.layout import FIRST_COLUMNS, SHAPE_COLUMNS
from pocketgs.splat.webgpu.passes import GATHERED, SOURCES, TABLES

MOMENTS = ("first_moments", "second_moments")

_FRESH = np.uint32(1 << 31)
"""As in `gather_rows.wgsl`."""


def gather_rows(executor: Executor, change: RowChange, before: int, symbols: Symbols, sizes: Mapping[str, int]) -> None:
    """Put together the tables' rows anew, one table after the other: only one is held twice.

    Args:
        executor: holds the tables.
        change: which rows.
        before: how many there are.
        symbols: that follow from how many there will be.
        sizes: bytes of the buffers from now on.
    """
    executor.reserve({name: sizes[name] for name in (GATHERED, SOURCES)})
    executor.write(SOURCES, np.where(change.fresh, _FRESH, np.uint32(0)) | change.sources.astype(np.uint32))
    for table in TABLES:
        columns = _columns(table, symbols["coefficients"])
        values = {"before": before, "after": symbols["gaussians"], "columns": columns}
        executor.write_uniform("rows", {**_NOTHING, **values, "clears_fresh": int(table in MOMENTS)})
        executor.submit(f"gather {table}", symbols)
        executor.reserve({table: sizes[table]})
        executor.copy(GATHERED, table, 4 * columns * symbols["gaussians"])


def set_values(executor: Executor, change: RowChange, symbols: Symbols) -> None:
    """Give parameters new values, and their moments zeros.

    Args:
        executor: holds the tables, as they are after the change, and buffers for as many rows.
        change: which rows, and their values, as `checked_change` returns it.
        symbols: that follow from how many rows there are now.
    """
    layout = ParameterLayout(symbols["coefficients"])
    for name, (rows, values) in change.values.items():
        listed = {**symbols, "listed": len(rows)}
        executor.write(SOURCES, rows.astype(np.uint32))
        numbers = values.reshape(len(rows), layout.group(name).numbers(layout.coefficients))
        _set(executor, "sh" if name == "sh" else "shape", 0 if name == "sh" else FIRST_COLUMNS[name], numbers, listed)
        columns = layout.columns_of(name)
        zeros = np.zeros((len(rows), columns.stop - columns.start), np.float32)
        for table in MOMENTS:
            _set(executor, table, columns.start, zeros, listed)


_NOTHING = dict.fromkeys(("before", "after", "columns", "first_column", "listed", "clears_fresh"), 0)


def _set(executor: Executor, table: str, first: int, numbers: np.ndarray, symbols: Symbols) -> None:
    """Set (R, columns) numbers of a table from a column on, in the listed rows."""
    values = {"after": symbols["gaussians"], "columns": numbers.shape[1], "first_column": first, "listed": len(numbers)}
    executor.write(GATHERED, np.ascontiguousarray(numbers))
    executor.write_uniform("rows", {**_NOTHING, **values})
    executor.submit(f"set {table}", symbols)


def _columns(table: str, coefficients: int) -> int:
    """Columns of a table."""
    if table in MOMENTS:
        return ParameterLayout(coefficients).columns
    return SHAPE_COLUMNS if table == "shape" else 3 * coefficients
