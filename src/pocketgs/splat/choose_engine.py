"""The choice of an engine."""

from __future__ import annotations

from typing import get_args

from pocketgs.errors import PocketGSError
from pocketgs.splat.engine import Engine, EngineName, EngineOptions
from pocketgs.system.device import DeviceName

ENGINES = get_args(EngineName)


def create_engine(options: EngineOptions | None = None) -> Engine:
    """Create an engine.

    Args:
        options: None for the defaults.

    Raises:
        PocketGSError: the engine is not available here.
    """
    options = options or EngineOptions()
    # Numba is slow to load, and the package works without a graphics library.
    if chosen_engine(options) == "webgpu":
        from pocketgs.splat.webgpu.engine import WebGpuEngine

        return WebGpuEngine(options)
    from pocketgs.splat.cpu.engine import CpuEngine

    return CpuEngine(options.threads)


def chosen_engine(options: EngineOptions) -> DeviceName:
    """The name of the engine, with "auto" resolved: a GPU that is named is used, whatever it is.

    Raises:
        PocketGSError: the name is unknown, or a GPU is named that is not there or that the engine does not use.
    """
    if options.engine not in ENGINES:
        raise PocketGSError(f"engine {options.engine!r}: not known, expected one of {', '.join(ENGINES)}")
    if options.gpu is not None:
        if options.engine == "cpu":
            raise PocketGSError(f"gpu {options.gpu!r}: not used by engine cpu, expected --engine auto or webgpu")
        from pocketgs.gpu.adapters import choose_adapter

        choose_adapter(options.gpu)
        return "webgpu"
    return "webgpu" if options.engine == "webgpu" or (options.engine == "auto" and _has_gpu()) else "cpu"


def _has_gpu() -> bool:
    from pocketgs.gpu.adapters import has_gpu

    return has_gpu()
