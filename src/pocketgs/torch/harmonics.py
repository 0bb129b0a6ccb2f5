"""Spherical harmonics in given directions, with gradients with respect to directions and coefficients."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import Tensor

from pocketgs.errors import PocketGSError
from pocketgs.scene.spherical_harmonics import basis, basis_gradient
from pocketgs.splat.cpu.operators.harmonics import harmonics, harmonics_backward
from pocketgs.torch.arrays import array_of, check_shape, check_tensors, checked_dtype, torch_threads, whole_numbers
from pocketgs.torch.unsupported import first_derivative

HIGHEST_DEGREE = 3


class SphericalHarmonics(torch.autograd.Function):
    """`SphericalHarmonics.apply(directions, coefficients, used, drawn)`: (N, 3) values Σ_k Y_k(d) c_k.

    Arguments are (N, 3) directions of any length and (N, K, 3) coefficients, both float32 or both float64, the number
    of coefficients to use (1, 4, 9 or 16), and an (N,) bool mask of the values to compute.
    """

    @staticmethod
    def forward(ctx: Any, directions: Tensor, coefficients: Tensor, used: int, drawn: Tensor) -> Tensor:
        """Values where requested, otherwise 0."""
        rows = np.flatnonzero(drawn.numpy())
        ctx.save_for_backward(directions, coefficients, torch.from_numpy(rows))
        ctx.used = used
        return torch.from_numpy(values_of(directions, coefficients, used, rows, rows, len(directions)))

    @staticmethod
    @first_derivative
    def backward(ctx: Any, *d_outputs: Tensor) -> tuple[Tensor | None, ...]:
        """Gradients with respect to directions and coefficients."""
        directions, coefficients, kept = ctx.saved_tensors
        rows, d_values, wanted = kept.numpy(), array_of(d_outputs[0]), ctx.needs_input_grad[0]
        return (*gradients_of(directions, coefficients, ctx.used, rows, rows, d_values, wanted), None, None)


class ViewColours(torch.autograd.Function):
    """`ViewColours.apply(directions, coefficients, used, gaussians, packed)`: colours max(Σ_k Y_k(d) c_k + 0.5, 0).

    Arguments are those of `SphericalHarmonics`, with the (V,) int64 indices of the visible Gaussians, and whether the
    result has rows only for those: (V, 3) in place of (N, 3). The offset and the limit are 3DGS's.
    """

    @staticmethod
    def forward(
        ctx: Any, directions: Tensor, coefficients: Tensor, used: int, gaussians: np.ndarray, packed: bool
    ) -> Tensor:
        """Colours of visible Gaussians; the others are grey."""
        rows, count = (np.arange(len(gaussians)), len(gaussians)) if packed else (gaussians, len(directions))
        values = values_of(directions, coefficients, used, gaussians, rows, count)
        values += 0.5
        ctx.save_for_backward(directions, coefficients, *map(torch.from_numpy, (gaussians, rows, values >= 0.0)))
        ctx.used = used
        return torch.from_numpy(np.maximum(values, 0.0, out=values))

    @staticmethod
    @first_derivative
    def backward(ctx: Any, *d_outputs: Tensor) -> tuple[Tensor | None, ...]:
        """Gradients with respect to directions and coefficients."""
        directions, coefficients, *kept = ctx.saved_tensors
        gaussians, rows, passed = (each.numpy() for each in kept)
        d_values, wanted = array_of(d_outputs[0]) * passed, ctx.needs_input_grad[0]
        found = gradients_of(directions, coefficients, ctx.used, gaussians, rows, d_values, wanted)
        return (*found, None, None, None)


def values_of(
    directions: Tensor, coefficients: Tensor, used: int, gaussians: np.ndarray, rows: np.ndarray, count: int
) -> np.ndarray:
    """(count, 3) values of some Gaussians in the given rows, zeros in the others."""
    vectors, numbers = array_of(directions), array_of(coefficients)
    values = np.zeros((count, 3), vectors.dtype)
    if directions.dtype == torch.float64:
        basis_values = _basis(vectors[gaussians], used)[0]
        values[rows] = np.einsum("nk,nkc->nc", basis_values, numbers[gaussians, :used])
    else:
        harmonics(vectors, numbers, used, gaussians, rows, torch_threads(), values)
    return values


def gradients_of(
    directions: Tensor,
    coefficients: Tensor,
    used: int,
    gaussians: np.ndarray,
    rows: np.ndarray,
    d_values: np.ndarray,
    wanted: bool,
) -> tuple[Tensor | None, Tensor]:
    """Gradients with respect to all directions, if wanted, and coefficients."""
    vectors, numbers = array_of(directions), array_of(coefficients)
    d_directions = np.zeros((len(vectors) if wanted else 0, 3), vectors.dtype)
    d_coefficients = np.zeros(numbers.shape, numbers.dtype)
    if directions.dtype == torch.float64:
        found = _backward(vectors[gaussians], numbers[gaussians], used, d_values[rows])
        d_coefficients[gaussians] = found[1]
        if wanted:
            d_directions[gaussians] = found[0]
    else:
        threads = torch_threads()
        harmonics_backward(vectors, numbers, used, gaussians, rows, d_values, threads, d_directions, d_coefficients)
    return torch.from_numpy(d_directions) if wanted else None, torch.from_numpy(d_coefficients)


def _basis(directions: np.ndarray, used: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The harmonics in the directions, the normalised directions, and the original lengths."""
    lengths = np.maximum(np.linalg.norm(directions, axis=1, keepdims=True), 1e-12)
    units = directions / lengths
    return basis(units, used), units, lengths


def _backward(
    directions: np.ndarray, coefficients: np.ndarray, used: int, d_values: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """`harmonics_backward` in NumPy, for all rows."""
    values, units, lengths = _basis(directions, used)
    d_coefficients = np.zeros_like(coefficients)
    d_coefficients[:, :used] = values[:, :, None] * d_values[:, None, :]
    d_units = np.einsum("nki,nkc,nc->ni", basis_gradient(units, used), coefficients[:, :used], d_values)
    across = d_units - units * np.sum(units * d_units, axis=1, keepdims=True)
    return across / lengths, d_coefficients


def spherical_harmonics(degrees_to_use: int, dirs: Tensor, coeffs: Tensor, masks: Tensor | None = None) -> Tensor:
    """Σ_k Y_k(d) c_k, without the offset 0.5 of colours.

    Args:
        degrees_to_use: 0 to 3; coefficients of higher degrees are ignored.
        dirs: (..., 3) of any length.
        coeffs: (..., K, 3).
        masks: (...) bool, where to compute values; the others are 0.

    Returns:
        (..., 3).

    Raises:
        PocketGSError: shapes disagree, or the degree is not supported.
    """
    check_tensors(1, dirs=dirs)
    check_tensors(2, coeffs=coeffs)
    check_tensors(0, optional=True, masks=masks)
    checked_dtype({"dirs": dirs, "coeffs": coeffs})
    lead = tuple(dirs.shape[:-1])
    check_shape("dirs", dirs, (*lead, 3))
    check_shape("coeffs", coeffs, (*lead, -1, 3))
    (degree,) = whole_numbers(0, degrees_to_use=degrees_to_use)
    used = coefficients_used(degree, coeffs.shape[-2])
    drawn = torch.ones(lead, dtype=torch.bool) if masks is None else masks
    check_shape("masks", drawn, lead)
    values = SphericalHarmonics.apply(
        dirs.reshape(-1, 3), coeffs.reshape(-1, *coeffs.shape[-2:]), used, drawn.reshape(-1)
    )
    return values.reshape(*lead, 3)


def coefficients_used(degree: int, count: int) -> int:
    """Number of coefficients of harmonics up to the degree.

    Raises:
        PocketGSError: the degree is not supported, or needs more coefficients than `count`.
    """
    used = (degree + 1) ** 2
    if not 0 <= degree <= HIGHEST_DEGREE or used > count:
        found = f"degree {degree} with {count} coefficients"
        raise PocketGSError(f"spherical_harmonics: found {found}, expected 0 to {HIGHEST_DEGREE} and enough of them")
    return used
