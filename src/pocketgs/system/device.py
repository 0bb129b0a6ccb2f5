"""The devices that compute, and the memory that work takes there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

DeviceName = Literal["cpu", "webgpu"]
"""Names of the devices that compute: of every stage of the prior, of seeding, and of training."""

MB = 1_000_000
"""Bytes of a megabyte, the unit of all bounds of memory."""


@dataclass(frozen=True)
class MemoryNeed:
    """Bytes of memory that a piece of work needs, estimated before it starts.

    Attributes:
        process: of this process's memory.
        device: of a GPU's.
    """

    process: int
    device: int = 0
