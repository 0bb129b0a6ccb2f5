"""The sizes of Gaussians that a `.spz` holds: scenes in millimetres or kilometres may exceed them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pocketgs.scene.formats.spz_attributes import LOG_SCALE_ORIGIN, LOG_SCALE_STEPS
from pocketgs.scene.gaussians import Gaussians
from pocketgs.scene.warning import warn

LEAST, MOST = LOG_SCALE_ORIGIN, LOG_SCALE_ORIGIN + 255 / LOG_SCALE_STEPS
"""Logarithms of the smallest and the largest standard deviation; others are written as these."""

TOO_SMALL, TOO_LARGE = 0.03, 0.0005
"""Shares of the Gaussians that may be out of range: on fern and fox this changes images less than rounding to a small
.spz does. Large Gaussians show even if they are few."""


def exceeds_range(gaussians: Gaussians) -> bool:
    """Whether a `.spz` changes the sizes of so many Gaussians that it shows; log scales are finite."""
    small, large = _shares_out_of_range(gaussians)
    return small > TOO_SMALL or large > TOO_LARGE


def suitable_factor(gaussians: Gaussians) -> float:
    """The power of ten that scales the median Gaussian to about the middle of the range; log scales are finite."""
    median = float(np.median(gaussians.log_scales.max(axis=1)))
    return float(10.0 ** np.rint((0.5 * (LEAST + MOST) - median) / np.log(10.0)))


def warn_of_range(path: Path, gaussians: Gaussians) -> None:
    """Warn that a scene exceeds the range, and name the factor that would help; log scales are finite."""
    small, large = _shares_out_of_range(gaussians)
    factor = suitable_factor(gaussians)
    scale = f"give pocketgs convert --scale {factor:g}, or " if factor != 1.0 else ""
    warn(
        f"{path}: {small:.2%} of the Gaussians are smaller, and {large:.2%} larger than a .spz holds, "
        f"{np.exp(LEAST):.2g} to {np.exp(MOST):.3g} scene units: they are cut to that; {scale}write a .ply"
    )


def _shares_out_of_range(gaussians: Gaussians) -> tuple[float, float]:
    """Shares of the Gaussians that are too small, and too large; that discs become thicker hardly shows."""
    sizes = gaussians.log_scales.max(axis=1)
    return float(np.mean(sizes < LEAST)), float(np.mean(sizes > MOST))
