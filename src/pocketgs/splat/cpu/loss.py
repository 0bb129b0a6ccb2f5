"""The training losses and their gradient with respect to the rendered image."""

from __future__ import annotations

import numpy as np

from pocketgs.splat.constants import SSIM_WINDOW
from pocketgs.splat.cpu.dssim import dssim
from pocketgs.splat.cpu.image_rows import read_row, row_sum
from pocketgs.splat.cpu.lanes import LANES
from pocketgs.splat.settings import LossSettings
from pocketgs.system.compile import kernel


@kernel
def pointwise(
    rendered: np.ndarray,
    photo: np.ndarray,
    mask: np.ndarray,
    absolute_weight: float,
    squared_weight: float,
    gradient: np.ndarray,
    row_losses: np.ndarray,
) -> None:
    """Write `absolute_weight` · mean|x - y| + `squared_weight` · mean (x - y)² and its gradient; see `photometric`."""
    height, width = rendered.shape[1:]
    absolute = np.float32(absolute_weight / (3.0 * height * width))
    squared = np.float32(squared_weight / (3.0 * height * width))
    size = (width + LANES - 1) // LANES * LANES
    x, y, error = np.zeros(size, np.float32), np.zeros(size, np.float32), np.zeros(size, np.float32)
    for channel in range(3):
        for row in range(height):
            read_row(rendered[channel], photo[channel], mask, row, x, y)
            for column in range(width):
                difference = x[column] - y[column]
                error[column] = absolute * abs(difference) + squared * difference * difference
                slope = absolute * np.sign(difference) + np.float32(2.0) * squared * difference
                gradient[channel, row, column] = slope
            row_losses[channel, row] = row_sum(error)


def photometric(
    rendered: np.ndarray,
    photo: np.ndarray,
    mask: np.ndarray,
    settings: LossSettings,
    threads: int,
    gradient: np.ndarray,
    row_losses: np.ndarray,
) -> None:
    """Compute the loss of an image against its photograph.

    Args:
        rendered: (3, H, W) float32.
        photo: (3, H, W) uint8.
        mask: (H, W) bool, or (0, 0) for none. Outside it the photograph counts as equal to the rendering.
        settings: of the loss. Images smaller than a window of SSIM have no structural term.
        threads: number of threads.
        gradient: (3, H, W) float32, written: ∂loss/∂rendered.
        row_losses: (3, H) float32, written: parts of the loss, to be summed.
    """
    if settings.photometric == "l2":
        pointwise(rendered, photo, mask, 0.0, 1.0, gradient, row_losses)
    else:
        structural = settings.dssim_weight if min(rendered.shape[1:]) >= SSIM_WINDOW else 0.0
        pointwise(rendered, photo, mask, 1.0 - structural, 0.0, gradient, row_losses)
        if structural > 0.0:
            dssim(rendered, photo, mask, structural, threads, gradient, row_losses)
    if mask.size:
        gradient[:, ~mask] = 0.0
