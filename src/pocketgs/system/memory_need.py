"""Memory that a piece of work needs, estimated before it starts."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class MemoryNeed:
    """Bytes of memory: `process` of this process's, `device` of a GPU's."""

    process: int
    device: int = 0
