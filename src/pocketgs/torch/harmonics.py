"""Spherical harmonics in given directions, with gradients with respect to directions and coefficients."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import Tensor

from pocketgs.errors import PocketGSError
from pocketgs.scene.spherical_harmonics import basis, basis_gradient
from pocketgs.splat.cpu.operators.harmonics import harmonics, harmonics_backward
from pocketgs.torch.arrays import array_of, check_shape, checked_dtype, torch_threads, zeros

HIGHEST_DEGREE = 3


class SphericalHarmonics(torch.autograd.Function):
    """`SphericalHarmonics.apply(directions, coefficients, used, drawn)`: (N, 3) values Σ_k Y_k(d) c_k.

    Arguments are (N, 3) directions of any length and (N, K, 3) coefficients, both float32 or both float64, the number
    of coefficients to use (1, 4, 9 or 16), and an (N,) bool mask of the values to compute.
    """

    @staticmethod
    def forward(ctx: Any, directions: Tensor, coefficients: Tensor, used: int, drawn: Tensor) -> Tensor:
        """Values where requested, otherwise 0."""
        ctx.save_for_backward(directions, coefficients, drawn)
        ctx.used = used
        vectors, numbers, wanted = array_of(directions), array_of(coefficients), array_of(drawn)
        if directions.dtype == torch.float64:
            terms = np.einsum("nk,nkc->nc", _basis(vectors, used)[0], numbers[:, :used])
            return torch.from_numpy(np.where(wanted[:, None], terms, 0.0))
        values = np.empty((len(vectors), 3), np.float32)
        harmonics(vectors, numbers, used, wanted, torch_threads(), values)
        return torch.from_numpy(values)

    @staticmethod
    def backward(ctx: Any, *d_outputs: Tensor) -> tuple[Tensor | None, ...]:
        """Gradients with respect to directions and coefficients."""
        directions, coefficients, drawn = (array_of(tensor) for tensor in ctx.saved_tensors)
        d_values = array_of(d_outputs[0])
        wanted = ctx.needs_input_grad[0]
        if directions.dtype == np.float64:
            d_directions, d_coefficients = _backward(directions, coefficients, ctx.used, drawn, d_values)
        else:
            d_coefficients = zeros(*coefficients.shape)
            d_directions = zeros(len(directions) if wanted else 0, 3)
            harmonics_backward(
                directions, coefficients, ctx.used, drawn, d_values, torch_threads(), d_directions, d_coefficients
            )
        return torch.from_numpy(d_directions) if wanted else None, torch.from_numpy(d_coefficients), None, None


def _basis(directions: np.ndarray, used: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The harmonics in the directions, the normalised directions, and the original lengths."""
    lengths = np.maximum(np.linalg.norm(directions, axis=1, keepdims=True), 1e-12)
    return basis(directions / lengths, used), directions / lengths, lengths


def _backward(
    directions: np.ndarray, coefficients: np.ndarray, used: int, drawn: np.ndarray, d_values: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """`harmonics_backward` in NumPy."""
    values, units, lengths = _basis(directions, used)
    d_values = np.where(drawn[:, None], d_values, 0.0)
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
    checked_dtype({"dirs": dirs, "coeffs": coeffs})
    lead, used = tuple(dirs.shape[:-1]), (degrees_to_use + 1) ** 2
    check_shape("dirs", dirs, (*lead, 3))
    check_shape("coeffs", coeffs, (*lead, -1, 3))
    if not 0 <= degrees_to_use <= HIGHEST_DEGREE or used > coeffs.shape[-2]:
        found = f"degree {degrees_to_use} with {coeffs.shape[-2]} coefficients"
        raise PocketGSError(f"spherical_harmonics: found {found}, expected 0 to {HIGHEST_DEGREE} and enough of them")
    drawn = torch.ones(lead, dtype=torch.bool) if masks is None else masks
    check_shape("masks", drawn, lead)
    values = SphericalHarmonics.apply(
        dirs.reshape(-1, 3), coeffs.reshape(-1, *coeffs.shape[-2:]), used, drawn.reshape(-1)
    )
    return values.reshape(*lead, 3)
