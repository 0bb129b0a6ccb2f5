"""Conversion of tensors to the arrays of kernels, which share their memory if possible."""

from __future__ import annotations

import operator
from collections.abc import Mapping
from typing import Any

import numba
import numpy as np
import torch
from torch import Tensor

from pocketgs.errors import PocketGSError, counted, short
from pocketgs.system.cores import kernel_threads


def array_of(tensor: Tensor) -> np.ndarray:
    """The tensor as an array, not copied if it is contiguous."""
    return tensor.detach().contiguous().numpy()


def flat(tensor: Tensor, columns: int) -> np.ndarray:
    """(M, columns) of a (..., columns) tensor, not copied if it is contiguous."""
    return array_of(tensor).reshape(-1, columns)


def zeros(*shape: int) -> np.ndarray:
    """Float32 zeros for a gradient."""
    return np.zeros(shape, np.float32)


def torch_threads() -> int:
    """Number of threads for kernels: that of `torch.set_num_threads`."""
    threads = kernel_threads(torch.get_num_threads())
    numba.set_num_threads(threads)
    return threads


def check_tensors(least: int, /, optional: bool = False, **arguments: object) -> None:
    """Check that arguments are tensors of enough dimensions, before anything is read from their shapes.

    Args:
        least: the minimum number of dimensions.
        optional: whether arguments may be None.
        arguments: by name.

    Raises:
        PocketGSError: one is something else, or has fewer dimensions.
    """
    for name, found in arguments.items():
        if found is None and optional:
            continue
        if not isinstance(found, Tensor):
            raise PocketGSError(f"{name}: found {_kind(found)}, expected a tensor")
        if found.ndim < least:
            dimensions = counted(least, "dimension", "dimensions")
            raise PocketGSError(f"{name}: found shape {tuple(found.shape)}, expected at least {dimensions}")


def _kind(found: object) -> str:
    return "None" if found is None else f"{type(found).__module__}.{type(found).__name__}".removeprefix("builtins.")


def check_on_cpu(name: str, tensor: Tensor) -> None:
    """Check that kernels can read a tensor.

    Raises:
        PocketGSError: it is on another device.
    """
    if tensor.device.type != "cpu":
        raise PocketGSError(f"{name}: found a tensor on {tensor.device}, expected one on the CPU: tensor.cpu()")


def checked_dtype(tensors: Mapping[str, Tensor | None]) -> torch.dtype:
    """Check that all tensors have one floating-point type, and return it.

    Args:
        tensors: by the name of their argument.

    Raises:
        PocketGSError: one is not on the CPU, or is neither float32 nor float64, or differs from the first.
    """
    given = {name: tensor for name, tensor in tensors.items() if tensor is not None}
    first = next(iter(given))
    for name, tensor in given.items():
        check_on_cpu(name, tensor)
        if tensor.dtype not in (torch.float32, torch.float64):
            raise PocketGSError(f"{name}: found {tensor.dtype}, expected float32, or float64 for the slow reference")
        if tensor.dtype != given[first].dtype:
            raise PocketGSError(f"{name}: found {tensor.dtype}, expected {given[first].dtype} as {first} has")
    return given[first].dtype


def whole_numbers(least: int, /, **numbers: Any) -> list[int]:
    """Numbers as ints, which kernels need; callers may give tensors or arrays of one integer.

    Args:
        least: the smallest number allowed.
        numbers: by the name of their argument.

    Raises:
        PocketGSError: one is not an integer, or is less than that.
    """
    found = []
    for name, number in numbers.items():
        try:
            found.append(operator.index(number))
        except TypeError:
            shown = repr(number) if isinstance(number, float) else short(number)  # 64.0 must not read like an integer
            raise PocketGSError(f"{name}: found {shown}, expected an integer") from None
        if found[-1] < least:
            raise PocketGSError(f"{name}: found {found[-1]}, expected at least {least}")
    return found


def real_numbers(**numbers: Any) -> list[float]:
    """Numbers as floats: kernels do not take tensors, and would be compiled again for ints.

    Args:
        numbers: by the name of their argument.

    Raises:
        PocketGSError: one is not a number.
    """
    found = []
    for name, number in numbers.items():
        try:
            found.append(float(number))
        except (TypeError, ValueError, RuntimeError):  # PyTorch raises RuntimeError for several numbers
            raise PocketGSError(f"{name}: found {short(number)}, expected a number") from None
    return found


def check_shape(name: str, tensor: Tensor, *allowed: tuple[int, ...]) -> None:
    """Check that a tensor has one of the allowed shapes, in which -1 stands for any number.

    Raises:
        PocketGSError: it has another shape.
    """
    found = tuple(tensor.shape)
    for shape in allowed:
        if len(shape) == len(found) and all(side in (-1, other) for side, other in zip(shape, found, strict=True)):
            return
    expected = " or ".join(str(tuple("any" if side == -1 else side for side in shape)) for shape in allowed)
    raise PocketGSError(f"{name}: found shape {found}, expected {expected}".replace("'", ""))
