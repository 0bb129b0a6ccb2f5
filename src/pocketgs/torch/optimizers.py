"""An optimiser that updates only visible Gaussians."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import torch
from torch import Tensor

from pocketgs.errors import PocketGSError
from pocketgs.splat.cpu.operators.selected_adam import adam_of_rows
from pocketgs.torch.arrays import array_of, check_tensors, real_numbers, torch_threads


class SelectiveAdam(torch.optim.Adam):
    """Adam that leaves the moments and parameters of invisible Gaussians unchanged, in one pass.

    Like gsplat's, it has no bias correction, and each group contains one tensor.

    Args:
        params: tensors, or groups of one tensor with its learning rate.
        eps: guard against division by zero.
        betas: decay rates of the moments.
    """

    def __init__(self, params: Iterable[Any], eps: float = 1e-8, betas: tuple[float, float] = (0.9, 0.999)) -> None:
        super().__init__(params=params, eps=eps, betas=betas)

    @torch.no_grad()
    def step(self, visibility: Tensor) -> None:
        """Update the visible rows.

        Args:
            visibility: (N,) bool, visible rows.

        Raises:
            PocketGSError: a group contains several tensors, one that is not float32 with N rows, a sparse gradient, or
                a setting that is not a number.
        """
        check_tensors(0, visibility=visibility)
        seen = array_of(visibility.bool().flatten())
        for group in self.param_groups:
            if len(group["params"]) != 1:
                raise PocketGSError(f"SelectiveAdam: found {len(group['params'])} tensors in a group, expected one")
            values = group["params"][0]
            if values.grad is None:
                continue
            if values.grad.is_sparse:
                raise PocketGSError("SelectiveAdam: found a sparse gradient, expected a dense one: sparse_grad=False")
            if values.dtype != torch.float32 or len(values) != len(seen):
                found = f"{values.dtype} {tuple(values.shape)}"
                raise PocketGSError(f"SelectiveAdam: found {found}, expected float32 with {len(seen)} rows")
            (beta1, beta2), lr, eps = group["betas"], group["lr"], group["eps"]
            lr, beta1, beta2, eps = real_numbers(lr=lr, beta1=beta1, beta2=beta2, eps=eps)
            state = self.state[values]
            if not state:
                state["step"] = torch.tensor(0.0)
                state["exp_avg"], state["exp_avg_sq"] = torch.zeros_like(values), torch.zeros_like(values)
            for name in ("exp_avg", "exp_avg_sq"):
                # The kernel updates them in place: it would update a copy of moments that are not contiguous.
                state[name] = state[name].contiguous()
            updated = values.detach().contiguous()
            shape = (len(values), math.prod(values.shape[1:]))
            tensors = (updated, values.grad, state["exp_avg"], state["exp_avg_sq"])
            rows, gradients, moments, squares = (array_of(tensor).reshape(shape) for tensor in tensors)
            adam_of_rows(rows, gradients, moments, squares, seen, lr, beta1, beta2, eps, torch_threads())
            if not values.is_contiguous():
                # Columns of a larger tensor, as trainers slice harmonics.
                values.copy_(updated)
