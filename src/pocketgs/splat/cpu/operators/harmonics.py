"""Spherical harmonics as an operator: values in given directions, and gradients."""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from pocketgs.splat.cpu.layout import COLOURS
from pocketgs.splat.cpu.spherical_harmonics import sh_basis, sh_basis_gradient
from pocketgs.system.compile import inlined, parallel_kernel
from pocketgs.system.dealing import PIECE, first_piece, take


@inlined
def _unit(vector: np.ndarray) -> tuple[tuple[float, float, float], float]:
    """The normalised vector, and its original length."""
    x, y, z = float(vector[0]), float(vector[1]), float(vector[2])
    length = max(math.sqrt(x * x + y * y + z * z), 1e-12)
    return (x / length, y / length, z / length), length


@parallel_kernel
def harmonics(
    directions: np.ndarray,
    coefficients: np.ndarray,
    used: int,
    gaussians: np.ndarray,
    rows: np.ndarray,
    threads: int,
    values: np.ndarray,
) -> None:
    """Compute Σ_k Y_k(d) c_k.

    Args:
        directions: (N, 3) float32 of any length.
        coefficients: (N, K, 3) float32.
        used: number of coefficients to use: 1, 4, 9 or 16.
        gaussians: (V,) int64 Gaussians to compute values of.
        rows: (V,) int64 their rows in `values`.
        threads: number of threads.
        values: (M, 3) float32, written in these rows.
    """
    counter = first_piece()
    for _ in prange(threads):
        basis = np.empty(16)
        first = PIECE * take(counter)
        while first < len(gaussians):
            for place in range(first, min(first + PIECE, len(gaussians))):
                i, row = gaussians[place], rows[place]
                x, y, z = _unit(directions[i])[0]
                sh_basis(x, y, z, used, basis)
                for channel in range(COLOURS):
                    value = 0.0
                    for k in range(used):
                        value += basis[k] * coefficients[i, k, channel]
                    values[row, channel] = value
            first = PIECE * take(counter)


@parallel_kernel
def harmonics_backward(
    directions: np.ndarray,
    coefficients: np.ndarray,
    used: int,
    gaussians: np.ndarray,
    rows: np.ndarray,
    d_values: np.ndarray,
    threads: int,
    d_directions: np.ndarray,
    d_coefficients: np.ndarray,
) -> None:
    """Gradients with respect to directions and coefficients.

    Args:
        directions: (N, 3) float32.
        coefficients: (N, K, 3) float32.
        used: number of coefficients to use.
        gaussians: (V,) int64, as in the forward pass.
        rows: (V,) int64 their rows in `d_values`.
        d_values: (M, 3) float32 gradient with respect to the values.
        threads: number of threads.
        d_directions: (N, 3) float32, written for these Gaussians; or (0, 3) for none.
        d_coefficients: (N, K, 3) float32, written for these Gaussians.
    """
    counter = first_piece()
    for _ in prange(threads):
        basis, gradient = np.empty(16), np.empty((16, 3))
        first = PIECE * take(counter)
        while first < len(gaussians):
            for place in range(first, min(first + PIECE, len(gaussians))):
                i, row = gaussians[place], rows[place]
                (x, y, z), length = _unit(directions[i])
                sh_basis(x, y, z, used, basis)
                for k in range(used):
                    for channel in range(COLOURS):
                        d_coefficients[i, k, channel] = basis[k] * d_values[row, channel]
                if used > 1 and len(d_directions):
                    sh_basis_gradient(x, y, z, used, gradient)
                    d_x, d_y, d_z = 0.0, 0.0, 0.0
                    for k in range(1, used):
                        weight = 0.0
                        for channel in range(COLOURS):
                            weight += coefficients[i, k, channel] * d_values[row, channel]
                        d_x += gradient[k, 0] * weight
                        d_y += gradient[k, 1] * weight
                        d_z += gradient[k, 2] * weight
                    # Normalisation removes the component along the direction.
                    along = x * d_x + y * d_y + z * d_z
                    d_directions[i, 0] = (d_x - along * x) / length
                    d_directions[i, 1] = (d_y - along * y) / length
                    d_directions[i, 2] = (d_z - along * z) / length
            first = PIECE * take(counter)
