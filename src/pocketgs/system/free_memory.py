"""The memory that this process may still take."""

from __future__ import annotations

from pathlib import Path

import psutil

from pocketgs.system.cores import CONTROL_GROUPS


def free_memory() -> float:
    """Bytes that this process may still take: what the machine has left, limited by what its container has left."""
    return min(psutil.virtual_memory().available, memory_left(CONTROL_GROUPS))


def memory_left(groups: Path) -> float:
    """Bytes left of the limit of the Linux control groups mounted at `groups`; infinite without a limit.

    Files that were read once count as used there, but make room when memory is needed.
    https://docs.kernel.org/admin-guide/cgroup-v2.html (memory.max), and version 1's memory.limit_in_bytes.
    """
    folder, names = groups, ("memory.max", "memory.current", "inactive_file")
    if not (groups / "memory.max").is_file():
        folder, names = groups / "memory", ("memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file")
    try:
        limit, used = (float((folder / name).read_text().replace("max", "inf")) for name in names[:2])
        counts = dict(line.split() for line in (folder / "memory.stat").read_text().splitlines())
        return max(0.0, limit - used + float(counts[names[2]]))
    except (OSError, ValueError, KeyError):
        return float("inf")
