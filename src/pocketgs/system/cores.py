"""The number of cores that this process may use, and of threads for its kernels."""

from __future__ import annotations

import math
import os
from functools import cache
from pathlib import Path

CONTROL_GROUPS = Path("/sys/fs/cgroup")


@cache
def usable_cores() -> int:
    """Number of cores that this process may use: its CPU affinity, limited by its CPU quota.

    A container on a large machine often has a quota of two cores and sees all of them. One thread per visible core
    would spend most of its time waiting.
    """
    affinity = getattr(os, "sched_getaffinity", None)
    bound = len(affinity(0)) if affinity else os.cpu_count() or 1
    return max(1, math.ceil(min(bound, time_quota(CONTROL_GROUPS))))


def kernel_threads(asked: int | None) -> int:
    """Number of kernel threads: as requested, or one per usable core; at most Numba's own limit."""
    import numba  # takes half a second to import, which reading a capture need not wait for

    return min(asked or usable_cores(), numba.config.NUMBA_NUM_THREADS)


def time_quota(groups: Path) -> float:
    """CPU quota, in cores, from the Linux control groups mounted at `groups`; infinite without a limit.

    https://docs.kernel.org/admin-guide/cgroup-v2.html (cpu.max), and version 1's cpu.cfs_quota_us.
    """
    try:
        if (groups / "cpu.max").is_file():
            quota, period = (groups / "cpu.max").read_text().split()
        else:
            quota, period = ((groups / "cpu" / f"cpu.cfs_{name}_us").read_text() for name in ("quota", "period"))
        granted = float(quota) / float(period)  # "max", and -1 in version 1, mean no limit
        return granted if granted > 0 else math.inf
    except (OSError, ValueError, ZeroDivisionError):
        return math.inf
