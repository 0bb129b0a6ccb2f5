"""How many cores this process may use, and how many threads its work is split among."""

from __future__ import annotations

import math
import os
from functools import cache
from pathlib import Path

CONTROL_GROUPS = Path("/sys/fs/cgroup")


@cache
def usable_cores() -> int:
    """The cores that the system lets this process use: those it is bound to, and no more than its quota of time fills.

    A container on a large machine is often granted two cores' time and shown all of them: a thread for each of those
    would wait for its turn most of the time.
    """
    affinity = getattr(os, "sched_getaffinity", None)
    bound = len(affinity(0)) if affinity else os.cpu_count() or 1
    return max(1, math.ceil(min(bound, time_quota(CONTROL_GROUPS))))


def kernel_threads(asked: int | None) -> int:
    """Threads for kernels: as many as are asked for, or one for each usable core; never more than Numba has."""
    import numba  # the compiler takes half a second to load, which reading a capture need not wait for

    return min(asked or usable_cores(), numba.config.NUMBA_NUM_THREADS)


def time_quota(groups: Path) -> float:
    """Cores' time that Linux's control groups, mounted at `groups`, grant this process; infinite without a limit.

    https://docs.kernel.org/admin-guide/cgroup-v2.html (cpu.max), and version 1's cpu.cfs_quota_us.
    """
    try:
        if (groups / "cpu.max").is_file():
            quota, period = (groups / "cpu.max").read_text().split()
        else:
            quota, period = ((groups / "cpu" / f"cpu.cfs_{name}_us").read_text() for name in ("quota", "period"))
        granted = float(quota) / float(period)  # "max", and -1 in version 1, stand for no limit
        return granted if granted > 0 else math.inf
    except (OSError, ValueError, ZeroDivisionError):
        return math.inf
