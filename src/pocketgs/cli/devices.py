"""Output of `pocketgs info --devices`: the GPUs that WebGPU finds, and which engines can use them."""

from __future__ import annotations

from collections.abc import Sequence

from pocketgs.errors import counted
from pocketgs.gpu.adapters import Adapter

FEATURES = ("subgroup", "shader-f16", "shader-float32-atomic", "timestamp-query")
"""Optional features that affect speed, memory or measurements; the engine does not require them."""

NO_ADAPTER = (
    "no GPU: WebGPU finds no Vulkan, Metal or DX12 driver; on Debian and Ubuntu, libvulkan1 is the loader and "
    "mesa-vulkan-drivers has the drivers of AMD and Intel, and a software adapter"
)


def device_lines(adapters: Sequence[Adapter], threads: int) -> list[str]:
    """Describe the devices of this machine.

    Args:
        adapters: best first.
        threads: of the CPU engine.
    """
    best = next((adapter for adapter in adapters if not adapter.is_software and not adapter.lacks()), None)
    lines = [line for adapter in adapters for line in _adapter_lines(adapter, adapter is best)] or [NO_ADAPTER]
    cpu = f"CPU engine: {counted(threads, 'thread', 'threads')}"
    return [*lines, cpu if best else f"{cpu}; used by engine auto"]


def _adapter_lines(adapter: Adapter, is_best: bool) -> list[str]:
    present = [name for name in FEATURES if name in adapter.features]
    absent = [name for name in FEATURES if name not in adapter.features]
    return [
        f"{adapter.name}: {adapter.kind}, {adapter.backend}, {adapter.driver or 'unnamed driver'}",
        f"  {_use(adapter, is_best)}",
        f"  features: {', '.join(present) or 'none of interest'}{'; not ' + ', '.join(absent) if absent else ''}",
        f"  limits: {_limits(adapter.limits)}",
    ]


def _use(adapter: Adapter, is_best: bool) -> str:
    """Which engine option uses the adapter, or why none can."""
    if missing := adapter.lacks():
        return f"not usable: {'; '.join(missing)}"
    if is_best:
        return "used by engine auto"
    if adapter.is_software:
        return "used by engine webgpu; not by auto, since it is a software adapter"
    return "used by engine webgpu with --gpu and its name"


def _limits(limits: dict[str, int]) -> str:
    """The limits that bound the size of a scene or decide whether passes run."""
    return ", ".join(
        [
            f"buffers of {limits['max-buffer-size'] / 1e6:,.0f} MB",
            f"bindings of {limits['max-storage-buffer-binding-size'] / 1e6:,.0f} MB",
            f"{limits['max-storage-buffers-per-shader-stage']} storage buffers per stage",
            f"{limits['max-compute-workgroup-storage-size']:,} bytes of workgroup memory",
        ]
    )
