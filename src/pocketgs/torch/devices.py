"""Scripts that name the device "cuda", run on the CPU."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import torch
from torch.overrides import TorchFunctionMode

_BEFORE_CUDA = 5
"""Priority among the functions that place loaded storages; that of CUDA is 20."""


class CudaMeansCpu(TorchFunctionMode):
    """Every function and method of PyTorch takes the device "cuda", of any number, for the CPU."""

    def __torch_function__(
        self, function: Callable[..., Any], types: Any, args: tuple[Any, ...] = (), kwargs: dict[str, Any] | None = None
    ) -> Any:
        """Call the function with the CPU in place of CUDA devices."""
        if function is torch.Tensor.cuda:
            return args[0]
        named = {name: _on_cpu(value) for name, value in (kwargs or {}).items()}
        return function(*map(_on_cpu, args), **named)


_installed = CudaMeansCpu()
_is_installed = False


def let_cuda_mean_cpu() -> None:
    """Let "cuda" mean the CPU in this thread, and in files that `torch.load` reads, for the rest of this process."""
    global _is_installed
    if _is_installed:
        return
    _is_installed = True
    _installed.__enter__()
    torch.serialization.register_package(_BEFORE_CUDA, lambda storage: None, _stays_on_cpu)
    torch.cuda.synchronize = lambda device=None: None


def _on_cpu(value: Any) -> Any:
    """The CPU for a CUDA device; anything else as it is."""
    if isinstance(value, torch.device):
        return torch.device("cpu") if value.type == "cuda" else value
    is_cuda = isinstance(value, str) and value.partition(":")[0] == "cuda"
    return "cpu" if is_cuda else value


def _stays_on_cpu(storage: Any, location: str) -> Any:
    """The storage, if it was saved on a CUDA device or is to be loaded to one; otherwise None."""
    return storage if location.partition(":")[0] == "cuda" else None
