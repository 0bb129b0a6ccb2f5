"""Colour transforms of the rendered image, and their gradients; see `splat/reference/colours.py`.

The update of a transform's twelve numbers uses the reference's NumPy code.
"""

from __future__ import annotations

import numpy as np
from numba import prange

from pocketgs.system.compile import parallel_kernel
from pocketgs.system.dealing import first_piece, take


@parallel_kernel
def transform(image: np.ndarray, matrix: np.ndarray, threads: int, out: np.ndarray) -> None:
    """Write A c + b of every colour c.

    Args:
        image: (3, H, W) float32.
        matrix: (3, 4) float32 [A | b].
        threads: number of threads.
        out: (3, H, W) float32, written.
    """
    counter = first_piece()
    for _ in prange(threads):
        row = take(counter)
        while row < image.shape[1]:
            for channel in range(3):
                a, b, c, offset = matrix[channel]
                for column in range(image.shape[2]):
                    mixed = a * image[0, row, column] + b * image[1, row, column] + c * image[2, row, column]
                    out[channel, row, column] = mixed + offset
            row = take(counter)


@parallel_kernel
def transform_backward(
    image: np.ndarray, matrix: np.ndarray, threads: int, gradient: np.ndarray, row_sums: np.ndarray
) -> None:
    """Gradients with respect to the image and the transform, from that with respect to the transformed colours.

    Args:
        image: (3, H, W) float32.
        matrix: (3, 4) float32 [A | b].
        threads: number of threads.
        gradient: (3, H, W) float32, with respect to the output of `transform`; overwritten by that with respect to
            `image`.
        row_sums: (H, 3, 4) float32, written: parts of the gradient with respect to `matrix`, to be summed.
    """
    counter = first_piece()
    for _ in prange(threads):
        row = take(counter)
        while row < image.shape[1]:
            for channel in range(3):
                red = green = blue = alone = np.float32(0.0)
                for column in range(image.shape[2]):
                    d = gradient[channel, row, column]
                    red += d * image[0, row, column]
                    green += d * image[1, row, column]
                    blue += d * image[2, row, column]
                    alone += d
                row_sums[row, channel, 0] = red
                row_sums[row, channel, 1] = green
                row_sums[row, channel, 2] = blue
                row_sums[row, channel, 3] = alone
            for column in range(image.shape[2]):
                x, y, z = gradient[0, row, column], gradient[1, row, column], gradient[2, row, column]
                for channel in range(3):
                    mixed = matrix[0, channel] * x + matrix[1, channel] * y + matrix[2, channel] * z
                    gradient[channel, row, column] = mixed
            row = take(counter)
