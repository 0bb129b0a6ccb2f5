"""Scripts that name the device "cuda", run on the CPU."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import torch
from torch.overrides import TorchFunctionMode

_BEFORE_CUDA = 5
"""Priority among the functions that place loaded storages; that of CUDA is 20."""

_ON_CPU_ALREADY = (torch.Tensor.cuda, torch.Tensor.pin_memory)

_OF_DEVICES_ALONE = ("reset_peak_memory_stats", "set_device", "synchronize")
"""Functions of `torch.cuda` that do nothing to the CPU, and raise errors where there is no CUDA device."""


class CudaMeansCpu(TorchFunctionMode):
    """Every function and method of PyTorch takes the device "cuda", of any number, or its number for the CPU."""

    def __torch_function__(
        self, function: Callable[..., Any], types: Any, args: tuple[Any, ...] = (), kwargs: dict[str, Any] | None = None
    ) -> Any:
        """Call the function with the CPU in place of CUDA devices."""
        if function in _ON_CPU_ALREADY:
            return args[0]
        named = {name: _on_cpu(value, name == "device") for name, value in (kwargs or {}).items()}
        number = 1 if function is torch.Tensor.to else None  # the place of what may be a device's number
        return function(*(_on_cpu(value, place == number) for place, value in enumerate(args)), **named)


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
    for name in _OF_DEVICES_ALONE:
        setattr(torch.cuda, name, lambda device=None: None)


def _on_cpu(value: Any, may_be_number: bool) -> Any:
    """The CPU for a CUDA device, or for its number where that may be given; anything else as it is."""
    if may_be_number and type(value) is int:
        return "cpu"
    if isinstance(value, torch.device):
        return torch.device("cpu") if value.type == "cuda" else value
    is_cuda = isinstance(value, str) and value.partition(":")[0] == "cuda"
    return "cpu" if is_cuda else value


def _stays_on_cpu(storage: Any, location: str) -> Any:
    """The storage, if it was saved on a CUDA device or is to be loaded to one; otherwise None."""
    return storage if location.partition(":")[0] == "cuda" else None
