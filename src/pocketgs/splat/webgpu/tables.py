"""Writing a run's tables on the GPU, and reading them back."""

from __future__ import annotations

from dataclasses import fields

import numpy as np

from pocketgs.gpu.executor import Executor
from pocketgs.scene.gaussians import Gaussians
from pocketgs.splat.colours import COLUMNS, UPDATES
from pocketgs.splat.engine import OptimiserState
from pocketgs.splat.parameters import ParameterLayout
from pocketgs.splat.rows import Statistics
from pocketgs.splat.webgpu.buffers import STATISTICS
from pocketgs.splat.webgpu.layout import SHAPE_COLUMNS
from pocketgs.splat.webgpu.scene_columns import from_columns, to_columns, transposed

_MOMENTS = ("first_moments", "second_moments")


def write_scene(executor: Executor, scene: Gaussians) -> None:
    """Write all parameters. No bounds of clusters hold then."""
    for name, values in zip(("shape", "sh"), to_columns(scene), strict=True):
        executor.write(name, values)
    executor.clear("cluster_bounds")


def read_scene(executor: Executor, count: int, coefficients: int) -> Gaussians:
    """Read all parameters."""
    shape = _read_columns(executor, "shape", SHAPE_COLUMNS, count)
    return from_columns(shape, _read_columns(executor, "sh", 3 * coefficients, count))


def write_optimiser_state(executor: Executor, state: OptimiserState | None) -> None:
    """Write the moments and the photographs' colour transforms, or start them anew."""
    for name in (*_MOMENTS, "colours"):
        executor.clear(name)
    if state is not None:
        for name in _MOMENTS:
            executor.write(name, transposed(getattr(state, name)))
        if state.colours is not None:
            executor.write("colours", state.colours)


def read_optimiser_state(
    executor: Executor, count: int, coefficients: int, photographs: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """The moments, (N, columns) each, and the photographs' colour transforms, or None where none was learned."""
    columns = ParameterLayout(coefficients).columns
    first, second = (transposed(_read_columns(executor, name, columns, count)) for name in _MOMENTS)
    colours = executor.read("colours", np.float32, photographs * COLUMNS).reshape(photographs, COLUMNS)
    return first, second, colours if colours[:, UPDATES].any() else None


def write_statistics(executor: Executor, statistics: Statistics | None) -> None:
    """Write sums, or zeros."""
    executor.clear("statistics")
    if statistics is not None:
        columns = [getattr(statistics, column.name) for column in fields(Statistics)]
        executor.write("statistics", np.stack(columns).astype(np.float32))


def read_statistics(executor: Executor, count: int) -> Statistics:
    """Read the sums."""
    return Statistics(*_read_columns(executor, "statistics", STATISTICS, count))


def _read_columns(executor: Executor, name: str, columns: int, count: int) -> np.ndarray:
    """(columns, N) float32."""
    return executor.read(name, np.float32, columns * count).reshape(columns, count)
