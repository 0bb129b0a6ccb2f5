"""What `pocketgs info --devices` says: which GPUs WebGPU finds, and what the engines make of them."""

from __future__ import annotations

from collections.abc import Sequence

from pocketgs.gpu.adapters import Adapter

FEATURES = ("subgroup", "shader-f16", "shader-float32-atomic", "timestamp-query")
"""Optional features that make a difference to speed, memory or measurement; the engine needs none of them."""

NO_ADAPTER = (
    "no GPU: WebGPU finds no Vulkan, Metal or DX12 driver; on Debian and Ubuntu, libvulkan1 is the loader and "
    "mesa-vulkan-drivers has the drivers of AMD and Intel, and a software adapter"
)


def device_lines(adapters: Sequence[Adapter], threads: int) -> list[str]:
    """What there is to compute on, in words.

    Args:
        adapters: the best first.
        threads: that the CPU engine would use.
    """
    best = next((adapter for adapter in adapters if not adapter.is_software and not adapter.lacks()), None)
    lines = [line for adapter in adapters for line in _adapter_lines(adapter, adapter is best)] or [NO_ADAPTER]
    cpu = f"CPU engine: {threads} {'thread' if threads == 1 else 'threads'}"
    return [*lines, cpu if best else f"{cpu}; engine auto takes it"]


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
    """Which choice of engine takes the adapter, or why none does."""
    if missing := adapter.lacks():
        return f"no engine takes it: {'; '.join(missing)}"
    if is_best:
        return "engine auto takes it"
    if adapter.is_software:
        return "engine webgpu takes it; auto does not, since the CPU does its work"
    return "engine webgpu takes it by --gpu and its name"


def _limits(limits: dict[str, int]) -> str:
    """The limits that bound the size of a scene or decide whether the passes run."""
    return ", ".join(
        [
            f"buffers of {limits['max-buffer-size'] / 1e6:,.0f} MB",
            f"bindings of {limits['max-storage-buffer-binding-size'] / 1e6:,.0f} MB",
            f"{limits['max-storage-buffers-per-shader-stage']} storage buffers a stage",
            f"{limits['max-compute-workgroup-storage-size']:,} bytes of workgroup memory",
        ]
    )
