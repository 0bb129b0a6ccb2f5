"""Memory and age of this process."""

from __future__ import annotations

import os
import re
import sys
import time
from functools import cache
from pathlib import Path

import psutil


def resident_bytes() -> int:
    """Resident memory of this process now."""
    return int(psutil.Process().memory_info().rss)


def peak_rss_mb() -> float:
    """Peak resident memory of this process so far, in MB of 10^6 bytes."""
    # On Linux, getrusage starts with the peak of the parent program.
    high_water = re.search(r"VmHWM:\s*(\d+) kB", _process_status())
    if high_water:
        return int(high_water[1]) * 1024 / 1e6
    if sys.platform == "win32":
        return float(psutil.Process().memory_info().peak_wset) / 1e6
    import resource

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / 1e6 if sys.platform == "darwin" else peak * 1024 / 1e6


def _process_status() -> str:
    """Content of /proc/self/status; empty where there is none, as on other systems and in some sandboxes."""
    try:
        return Path("/proc/self/status").read_text(encoding="ascii", errors="replace")
    except OSError:
        return ""


def seconds_since_start() -> float:
    """Wall time since this process started, whatever happens to the system's clock after the first call."""
    return time.monotonic() - _start_of(os.getpid())


@cache
def _start_of(process: int) -> float:
    """When a running process started, on the clock that is never set."""
    return time.monotonic() - (time.time() - float(psutil.Process(process).create_time()))
