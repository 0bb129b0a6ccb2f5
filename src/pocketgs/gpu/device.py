"""Opening a GPU. Devices are shared: one per adapter and set of features in a process."""

from __future__ import annotations

from typing import Any

from pocketgs.errors import PocketGSError
from pocketgs.gpu.adapters import BUFFER_LIMITS, NEEDED, TIMESTAMPS, Adapter

_open: dict[tuple[Any, frozenset[str]], Any] = {}


def shared_device(adapter: Adapter, features: frozenset[str] = frozenset()) -> Any:
    """The shared device of an adapter with these features, opened on first use.

    Raises:
        PocketGSError: the adapter lacks a feature, or the driver fails.
    """
    key = (adapter.handle, features)
    if key not in _open:
        _open[key] = open_device(adapter, features)
    return _open[key]


def forget_device(device: Any) -> None:
    """Drop a lost device, so that the next call opens a new one."""
    for key in [key for key, present in _open.items() if present is device]:
        del _open[key]


def open_device(adapter: Adapter, features: frozenset[str] = frozenset()) -> Any:
    """Open an adapter with WebGPU's default limits, except buffer sizes, which are the adapter's maximum.

    Timestamps are enabled where the adapter supports them.

    Raises:
        PocketGSError: the adapter lacks a feature, or the driver fails.
    """
    if missing := features - adapter.features:
        raise PocketGSError(f"{adapter.name}: lacks {', '.join(sorted(missing))}, expected options that do not need it")
    # Limits not named would default to the adapter's own, and passes that need too much would go unnoticed.
    limits = {**NEEDED, **{name: adapter.limits[name] for name in BUFFER_LIMITS}}
    wanted = sorted(features | ({TIMESTAMPS} & adapter.features))
    try:
        return adapter.handle.request_device_sync(required_features=wanted, required_limits=limits)
    except RuntimeError as error:
        raise PocketGSError(f"{adapter.name}: the device cannot be opened: {error}; expected --engine cpu") from error
