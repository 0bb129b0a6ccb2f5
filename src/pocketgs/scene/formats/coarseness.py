"""Warnings where centres are rounded coarsely for the scene: one far Gaussian makes a file's grid so for all."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pocketgs.scene.gaussians import Gaussians
from pocketgs.scene.warning import warn

LARGEST_STEP = 0.5
"""A step of centres, relative to the size of the median Gaussian, beyond which rounding shows: on fern, fox and lego a
step of half this size leaves 46 to 50 dB, one of twice the size 34 to 37."""


def is_coarse(gaussians: Gaussians, step: float) -> bool:
    """Whether a step of centres, in scene units, is more than half the size of most Gaussians, which are finite."""
    return step > LARGEST_STEP * _median_size(gaussians)


def warn_if_coarse(path: Path, gaussians: Gaussians, step: float) -> None:
    """Warn if centres are rounded to more than half the size of most Gaussians.

    Args:
        path: the file.
        gaussians: the scene; its centres and log scales are finite.
        step: the finest step of centres that the file allows, in scene units.
    """
    if not is_coarse(gaussians, step):
        return
    size, largest = _median_size(gaussians), float(np.abs(gaussians.means).max())
    warn(
        f"{path}: centres are rounded to steps of {step:.2g}, but half of the Gaussians are smaller than {size:.2g}: "
        f"the steps suit the farthest one, with a coordinate of {largest:.3g}. Leave far ones out with "
        "--crop-box xmin ymin zmin xmax ymax zmax of pocketgs convert, or write a .ply"
    )


def warn_if_far(path: Path, gaussians: Gaussians, stored: Sequence[np.ndarray]) -> None:
    """Warn if reading has rounded centres to more than half the size of most Gaussians.

    Args:
        path: the file.
        gaussians: the scene.
        stored: its x, y and z in the file, which may be more exact.
    """
    if max(values.dtype.itemsize for values in stored) <= gaussians.means.itemsize:
        return
    finite = gaussians.is_finite
    rounded = [finite & (values != means) for values, means in zip(stored, gaussians.means.T, strict=True)]
    if not np.any(rounded):
        return
    whole = gaussians.select(finite)
    largest = np.abs(whole.means).max()
    step = float(np.spacing(largest))
    if is_coarse(whole, step):
        warn(
            f"{path}: centres are rounded to steps of {step:.2g}, but half of the Gaussians are smaller than "
            f"{_median_size(whole):.2g}: scenes hold numbers of 32 bits, and coordinates reach {largest:.3g}. Move the "
            "scene to the origin in the program that wrote it"
        )


def _median_size(gaussians: Gaussians) -> float:
    """Median of the middle standard deviations, which grids are chosen to suit."""
    with np.errstate(over="ignore"):
        return float(np.exp(np.median(np.median(gaussians.log_scales, axis=1)).astype(np.float64)))
