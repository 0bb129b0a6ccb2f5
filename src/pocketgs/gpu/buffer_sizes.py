"""Bounds on the sizes of buffers."""

from __future__ import annotations

from collections.abc import Mapping

from pocketgs.errors import PocketGSError


def check_buffers(sizes: Mapping[str, int], largest: int, expected: str) -> None:
    """Refuse buffers of more than `largest` bytes.

    Args:
        sizes: bytes by buffer.
        largest: bytes that the device allows a single one.
        expected: what would help, for the message.

    Raises:
        PocketGSError: one is larger.
    """
    for name, size in sizes.items():
        if size > largest:
            raise PocketGSError(
                f"the GPU's buffer {name!r} would take {size / 1e6:.0f} MB, the device allows "
                f"{largest / 1e6:.0f} MB: expected {expected}"
            )


def fit(sizes: Mapping[str, int], largest: int, most: int) -> bool:
    """Whether a device holds some buffers: `largest` bytes in a single one, and `most` in all."""
    return max(sizes.values()) <= largest and sum(sizes.values()) <= most
