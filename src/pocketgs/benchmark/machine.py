"""Description of the machine that a benchmark runs on."""

from __future__ import annotations

import platform
import re
from pathlib import Path

import psutil

from pocketgs.system.cores import usable_cores


def describe_machine() -> dict[str, str]:
    """Processor, usable cores, memory and system."""
    return {
        "processor": _processor(),
        "cores": str(usable_cores()),
        "memory": f"{psutil.virtual_memory().total / 2**30:.0f} GiB",
        "system": f"{platform.system()} {platform.machine()}",
    }


def _processor() -> str:
    """The processor's name, if the system reports it."""
    try:
        told = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace")
    except OSError:
        told = ""
    name = re.search(r"^model name\s*:\s*(.+)$", told, re.MULTILINE)
    return name[1].strip() if name else platform.processor() or "unknown"
