"""The choice of where `rasterization` sorts and composites splats."""

from __future__ import annotations

from typing import TYPE_CHECKING, get_args

from pocketgs.errors import PocketGSError
from pocketgs.system.device import DeviceName

if TYPE_CHECKING:
    from pocketgs.splat.webgpu.compositor import SplatCompositor

_compositor: SplatCompositor | None = None


def set_engine(engine: DeviceName, gpu: str | None = None) -> None:
    """Choose where `rasterization` sorts splats, lists them for tiles and composites them, both ways.

    Projection and colours, which take far less time, remain on the CPU, as all tensors do: what is composited is
    written to the GPU, and the image read back. Tensors of float64, and functions other than `rasterization`, always
    use the CPU.

    Args:
        engine: "cpu", the default, or "webgpu".
        gpu: part of the name of the GPU to use, or None for the best.

    Raises:
        PocketGSError: there is no such engine or GPU.
    """
    global _compositor
    if engine not in get_args(DeviceName):
        raise PocketGSError(f"set_engine: found {engine!r}, expected {' or '.join(get_args(DeviceName))}")
    if engine == "cpu":
        _compositor = None
        return
    from pocketgs.splat.webgpu.compositor import SplatCompositor

    _compositor = SplatCompositor(gpu)


def gpu_compositor() -> SplatCompositor | None:
    """The compositor on the chosen GPU; None on the CPU."""
    return _compositor
