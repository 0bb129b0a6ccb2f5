"""1 - SSIM and its gradient, in one pass over the image's rows.

SSIM needs two passes of 11 x 11 windows: means over the image, then the adjoint of the means over SSIM's derivatives.
Both are separable, so each thread moves down its band of rows and keeps the last 11 horizontally filtered rows of each
pass in a ring buffer. Only the gradient has the size of an image.
"""

from __future__ import annotations

import numpy as np
from numba import prange

from pocketgs.splat.constants import SSIM_C1, SSIM_C2, SSIM_WINDOW
from pocketgs.splat.cpu.image_rows import read_row, row_sum
from pocketgs.splat.cpu.lanes import LANES, broadcast, load, store
from pocketgs.splat.reference.loss import ssim_window
from pocketgs.system.compile import parallel_kernel, part
from pocketgs.system.dealing import first_piece, take

WINDOW = SSIM_WINDOW
_WEIGHTS = ssim_window().astype(np.float32)
_C1, _C2 = np.float32(SSIM_C1), np.float32(SSIM_C2)
_ZERO, _TWO = np.float32(0.0), np.float32(2.0)

# Rows of the ring buffers: the windowed means of the first pass, and the derivatives of the second.
_MEAN_X, _MEAN_Y, _SQUARES, _PRODUCT = range(4)
_D_MEAN, _D_SQUARES, _D_PRODUCT = range(3)


@part
def _aligned_zeros(size: int) -> np.ndarray:
    """(size,) zeros, aligned such that no vector straddles two cache lines: such loads cost twice as much."""
    room = np.zeros(size + LANES, np.float32)
    start = -room.ctypes.data % (4 * LANES) // 4
    return room[start : start + size]


@part
def _filter_row(x: np.ndarray, y: np.ndarray, weights: np.ndarray, stride: int, ring: np.ndarray, slot: int) -> None:
    """Horizontal windowed means of x, y, x² + y² and xy, for the windows that begin at each column."""
    for column in range(0, stride - LANES, LANES):
        mean_x = mean_y = squares = product = broadcast(_ZERO)
        for tap in range(WINDOW):
            weight = weights[tap]
            a, b = load(x, column + tap), load(y, column + tap)
            wa, wb = a * weight, b * weight
            mean_x, mean_y = mean_x + wa, mean_y + wb
            squares, product = squares + wa * a + wb * b, product + wa * b
        store(ring, (slot * 4 + _MEAN_X) * stride + column, mean_x)
        store(ring, (slot * 4 + _MEAN_Y) * stride + column, mean_y)
        store(ring, (slot * 4 + _SQUARES) * stride + column, squares)
        store(ring, (slot * 4 + _PRODUCT) * stride + column, product)


@part
def _similarity_row(
    ring: np.ndarray,
    first_row: int,
    weights: np.ndarray,
    stride: int,
    windows: int,
    derivatives: np.ndarray,
    similarity: np.ndarray,
) -> None:
    """SSIM of the windows that begin at `first_row`, and its derivatives with respect to the four windowed means.

    See `splat/reference/loss.py`. `derivatives` has a margin of LANES zeros before and after each row.
    """
    starts = np.empty(WINDOW, np.int64)
    for tap in range(WINDOW):
        starts[tap] = (first_row + tap) % WINDOW * 4 * stride
    for column in range(0, stride - LANES, LANES):
        mean_x = mean_y = squares = product = broadcast(_ZERO)
        for tap in range(WINDOW):
            weight, base = weights[tap], starts[tap] + column
            mean_x = mean_x + load(ring, base + _MEAN_X * stride) * weight
            mean_y = mean_y + load(ring, base + _MEAN_Y * stride) * weight
            squares = squares + load(ring, base + _SQUARES * stride) * weight
            product = product + load(ring, base + _PRODUCT * stride) * weight
        xy, xx_yy = mean_x * mean_y, mean_x * mean_x + mean_y * mean_y
        luminance, luminance_bound = xy * _TWO + _C1, xx_yy + _C1
        structure, structure_bound = (product - xy) * _TWO + _C2, squares - xx_yy + _C2
        luminance_slope = luminance / (luminance_bound * structure_bound)
        value = luminance_slope * structure
        d_squares = _ZERO - value / structure_bound
        d_product = luminance_slope * _TWO
        d_mean = value * _TWO * (mean_y / luminance - mean_x / luminance_bound)
        d_mean = d_mean - mean_x * _TWO * d_squares - mean_y * d_product
        row = 2 * LANES + stride
        store(similarity, column, value)
        store(derivatives, LANES + column + _D_MEAN * row, d_mean)
        store(derivatives, LANES + column + _D_SQUARES * row, d_squares)
        store(derivatives, LANES + column + _D_PRODUCT * row, d_product)
    for k in range(3):
        start = LANES + k * (2 * LANES + stride)
        derivatives[start + windows : start + stride] = _ZERO
    similarity[windows:] = _ZERO


@part
def _spread_row(derivatives: np.ndarray, weights: np.ndarray, stride: int, ring: np.ndarray, slot: int) -> None:
    """Horizontal adjoint of the windowed means: each pixel sums over the windows that contain it."""
    row = 2 * LANES + stride
    for column in range(0, stride - LANES, LANES):
        d_mean = d_squares = d_product = broadcast(_ZERO)
        for tap in range(WINDOW):
            weight, base = weights[tap], LANES + column - tap
            d_mean = d_mean + load(derivatives, base + _D_MEAN * row) * weight
            d_squares = d_squares + load(derivatives, base + _D_SQUARES * row) * weight
            d_product = d_product + load(derivatives, base + _D_PRODUCT * row) * weight
        store(ring, (slot * 3 + _D_MEAN) * stride + column, d_mean)
        store(ring, (slot * 3 + _D_SQUARES) * stride + column, d_squares)
        store(ring, (slot * 3 + _D_PRODUCT) * stride + column, d_product)


@part
def _gradient_row(
    ring: np.ndarray,
    row: int,
    x: np.ndarray,
    y: np.ndarray,
    weights: np.ndarray,
    stride: int,
    out: np.ndarray,
) -> None:
    """Vertical adjoint: the gradient of the sum of SSIM over all windows with respect to a row of x."""
    starts = np.empty(WINDOW, np.int64)
    for tap in range(WINDOW):
        starts[tap] = (row - tap + WINDOW) % WINDOW * 3 * stride
    for column in range(0, stride - LANES, LANES):
        d_mean = d_squares = d_product = broadcast(_ZERO)
        for tap in range(WINDOW):
            weight, base = weights[tap], starts[tap] + column
            d_mean = d_mean + load(ring, base + _D_MEAN * stride) * weight
            d_squares = d_squares + load(ring, base + _D_SQUARES * stride) * weight
            d_product = d_product + load(ring, base + _D_PRODUCT * stride) * weight
        gradient = d_mean + load(x, column) * _TWO * d_squares + load(y, column) * d_product
        store(out, column, gradient)


@part
def _dssim_band(
    rendered: np.ndarray,
    photo: np.ndarray,
    mask: np.ndarray,
    scale: np.float32,
    first: int,
    end: int,
    gradient: np.ndarray,
    row_losses: np.ndarray,
) -> None:
    """`dssim` for one channel and the rows from `first` up to `end`."""
    height, width = rendered.shape
    windows_across, windows_down = width - WINDOW + 1, height - WINDOW + 1
    # Every row is followed by at least LANES padding numbers, which may be read. An odd number of vectors prevents
    # the rings' rows from mapping to the same cache sets.
    stride = ((width + LANES - 1) // LANES + 1 | 1) * LANES
    weights = _WEIGHTS.copy()
    x, y = np.zeros(stride + LANES, np.float32), np.zeros(stride + LANES, np.float32)
    means = _aligned_zeros(WINDOW * 4 * stride)
    spread = _aligned_zeros(WINDOW * 3 * stride)
    derivatives = np.zeros(3 * (2 * LANES + stride), np.float32)
    similarity, out = np.zeros(stride, np.float32), np.zeros(stride, np.float32)
    # A row's gradient needs the windows that begin up to 10 rows above it, which reach 10 rows below it.
    for row in range(max(0, first - WINDOW + 1), min(height, end + WINDOW - 1)):
        read_row(rendered, photo, mask, row, x, y)
        _filter_row(x, y, weights, stride, means, row % WINDOW)
        window_row = row - WINDOW + 1
        if window_row >= max(0, first - WINDOW + 1):
            _similarity_row(means, window_row, weights, stride, windows_across, derivatives, similarity)
            _spread_row(derivatives, weights, stride, spread, window_row % WINDOW)
            if first <= window_row:
                row_losses[window_row] -= scale * row_sum(similarity)
                read_row(rendered, photo, mask, window_row, x, y)
                _gradient_row(spread, window_row, x, y, weights, stride, out)
                for column in range(width):
                    gradient[window_row, column] -= scale * out[column]
    # No windows begin in the last rows, nor before the first: use zeros.
    for row in range(max(first, windows_down), end):
        start = row % WINDOW * 3 * stride
        spread[start : start + 3 * stride] = _ZERO
        read_row(rendered, photo, mask, row, x, y)
        _gradient_row(spread, row, x, y, weights, stride, out)
        for column in range(width):
            gradient[row, column] -= scale * out[column]


@parallel_kernel
def dssim(
    rendered: np.ndarray,
    photo: np.ndarray,
    mask: np.ndarray,
    weight: float,
    threads: int,
    gradient: np.ndarray,
    row_losses: np.ndarray,
) -> None:
    """Add `weight` · (1 - SSIM) to the losses and its gradient to `gradient`; see `photometric` in loss.py.

    SSIM is the mean over channels and over all 11 x 11 windows inside the image (Wang et al. 2004).
    """
    height, width = rendered.shape[1:]
    scale = np.float32(weight / (3.0 * (width - WINDOW + 1) * (height - WINDOW + 1)))
    # Bands overlap in rows that both filter, so there is only one per thread.
    counter = first_piece()
    for _ in prange(threads):
        piece = take(counter)
        while piece < 3 * threads:
            channel, band = piece % 3, piece // 3
            first, end = band * height // threads, (band + 1) * height // threads
            _dssim_band(
                rendered[channel], photo[channel], mask, scale, first, end, gradient[channel], row_losses[channel]
            )
            piece = take(counter)
    for channel in range(3):
        row_losses[channel, 0] += weight / 3.0
