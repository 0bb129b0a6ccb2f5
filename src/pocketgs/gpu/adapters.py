"""The GPUs of this machine, and the features that they lack."""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from pocketgs.errors import PocketGSError
from pocketgs.gpu.workgroups import MAX_ROW_LENGTH, THREADS

_PREFERENCE = {"DiscreteGPU": 0, "IntegratedGPU": 1, "VirtualGPU": 2, "Unknown": 3, "CPU": 4}
_SOFTWARE = ("llvmpipe", "swiftshader", "lavapipe", "basic render driver")
_DEVICE_FILES = ("dri/renderD*", "nvidia[0-9]*", "dxg", "kgsl*", "mali*", "nvhost*")

BUFFER_LIMITS = ("max-buffer-size", "max-storage-buffer-binding-size")
TIMESTAMPS = "timestamp-query"
"""Optional feature: timestamps at the start and end of passes."""

DRIVER_BYTES = 150_000_000
"""Of this process's memory that a GPU's driver takes, with its compiled shaders."""

NEEDED = {
    "max-storage-buffers-per-shader-stage": 8,
    "max-compute-invocations-per-workgroup": THREADS,
    "max-compute-workgroup-storage-size": 16384,
    "max-compute-workgroup-size-x": THREADS,
    "max-compute-workgroups-per-dimension": MAX_ROW_LENGTH,
}
"""Device limits that the passes need: no more than WebGPU guarantees."""


@dataclass(frozen=True)
class Adapter:
    """A GPU that WebGPU can open.

    Attributes:
        name: of the device.
        kind: "DiscreteGPU", "IntegratedGPU", "VirtualGPU", "CPU" or "Unknown".
        backend: "Vulkan", "Metal" or "D3D12".
        driver: version string of the driver.
        features: names of optional features.
        limits: by name.
        handle: the wgpu adapter.
    """

    name: str
    kind: str
    backend: str
    driver: str
    features: frozenset[str]
    limits: dict[str, int]
    handle: Any

    @property
    def is_software(self) -> bool:
        """Whether it runs on the CPU."""
        return self.kind == "CPU" or any(name in self.name.lower() for name in _SOFTWARE)

    @property
    def shares_memory(self) -> bool:
        """Whether it and the CPU have one memory: buffers then count as the process's too."""
        return self.kind != "DiscreteGPU"

    @property
    def largest_buffer(self) -> int:
        """Bytes of the largest buffer that a shader can use whole."""
        return min(self.limits[name] for name in BUFFER_LIMITS)

    def lacks(self) -> list[str]:
        """The limits that fall short of what the passes need, as text."""
        found = {name: self.limits.get(name, 0) for name in NEEDED}
        return [f"{name} {found[name]} (expected {least})" for name, least in NEEDED.items() if found[name] < least]


@cache
def adapters() -> tuple[Adapter, ...]:
    """All GPUs, best first; empty if there is no driver or wgpu cannot be loaded."""
    try:
        import wgpu
        from wgpu.backends.wgpu_native.extras import set_instance_extras
    except (ImportError, OSError):
        return ()
    # OpenGL lacks what the passes need, and probing it prints to the terminal.
    with suppress(RuntimeError):  # another library has opened GPUs before, with backends of its choice
        set_instance_extras(backends=["Vulkan", "Metal", "DX12"])
    try:
        with _without_complaints_about_displays():
            listed = [_adapter(handle) for handle in wgpu.gpu.enumerate_adapters_sync()]
    except RuntimeError:
        return ()
    found = [adapter for adapter in listed if not adapter.backend.startswith("OpenGL")]
    return tuple(sorted(found, key=lambda adapter: (adapter.is_software, _PREFERENCE.get(adapter.kind, 5))))


@contextmanager
def _without_complaints_about_displays() -> Iterator[None]:
    """Silence Wayland's library, which prints an error on machines without a screen if this variable is not set."""
    name = "XDG_RUNTIME_DIR"
    if name in os.environ:
        yield
        return
    os.environ[name] = tempfile.gettempdir()
    try:
        yield
    finally:
        del os.environ[name]


def _adapter(handle: Any) -> Adapter:
    info = handle.info
    return Adapter(
        name=info["device"] or info["vendor"] or "unnamed",
        kind=info["adapter_type"],
        backend=info["backend_type"],
        driver=info["description"],
        features=frozenset(handle.features),
        limits={name: int(value) for name, value in handle.limits.items()},
        handle=handle,
    )


def has_gpu() -> bool:
    """Whether there is a hardware GPU that can run the passes."""
    return _may_have_gpu() and any(not adapter.is_software and not adapter.lacks() for adapter in adapters())


def _may_have_gpu() -> bool:
    """Quick check before loading drivers, which takes 0.3 s and 70 MB: on Linux a GPU has a file in /dev."""
    return sys.platform != "linux" or any(any(Path("/dev").glob(pattern)) for pattern in _DEVICE_FILES)


def choose_adapter(name: str | None = None) -> Adapter:
    """The best adapter that can run the passes, or the best whose name contains `name`.

    Raises:
        PocketGSError: there is none, or it lacks a limit.
    """
    wanted = [adapter for adapter in adapters() if name is None or name.lower() in adapter.name.lower()]
    if not wanted:
        found = ", ".join(adapter.name for adapter in adapters()) or "none"
        what = "a GPU with a Vulkan, Metal or DX12 driver" if name is None else f"one named like {name!r}"
        raise PocketGSError(f"engine webgpu: found these devices: {found}; expected {what}, or --engine cpu")
    chosen = next((adapter for adapter in wanted if not adapter.lacks()), wanted[0])
    if missing := chosen.lacks():
        raise PocketGSError(f"{chosen.name}: {'; '.join(missing)}; --engine cpu works without it")
    return chosen
