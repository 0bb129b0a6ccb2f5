"""Opening a GPU: one device for each adapter and set of features, for as long as the process runs."""

from __future__ import annotations

from typing import Any

from pocketgs.errors import PocketGSError
from pocketgs.gpu.adapters import BUFFER_LIMITS, NEEDED, TIMESTAMPS, Adapter

_open: dict[tuple[Any, frozenset[str]], Any] = {}


def shared_device(adapter: Adapter, features: frozenset[str] = frozenset()) -> Any:
    """The device of an adapter with these features, opened at the first call.

    Raises:
        PocketGSError: the adapter lacks a feature, or the driver refuses.
    """
    key = (adapter.handle, features)
    if key not in _open:
        _open[key] = open_device(adapter, features)
    return _open[key]


def forget_device(device: Any) -> None:
    """Open another one next time: this one was lost."""
    for key in [key for key, present in _open.items() if present is device]:
        del _open[key]


def open_device(adapter: Adapter, features: frozenset[str] = frozenset()) -> Any:
    """Open an adapter, with the limits of WebGPU's core but for the size of buffers, which are the adapter's.

    It measures the time of passes where the adapter can, asked for or not.

    Raises:
        PocketGSError: the adapter lacks a feature, or the driver refuses.
    """
    if missing := features - adapter.features:
        raise PocketGSError(f"{adapter.name}: lacks {', '.join(sorted(missing))}, expected options that do without")
    # What is not asked for by name would be the adapter's own, and passes that need more would go unnoticed.
    limits = {**NEEDED, **{name: adapter.limits[name] for name in BUFFER_LIMITS}}
    wanted = sorted(features | ({TIMESTAMPS} & adapter.features))
    try:
        return adapter.handle.request_device_sync(required_features=wanted, required_limits=limits)
    except RuntimeError as error:
        raise PocketGSError(f"{adapter.name}: the device cannot be opened: {error}; expected --engine cpu") from error
