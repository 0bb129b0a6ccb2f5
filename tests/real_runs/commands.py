"""Commands in processes of their own, and what is asked of their results."""

from __future__ import annotations

import subprocess
import sys
from typing import Any


def succeeds(*command: object) -> str:
    """Run a command of ours in a process of its own, without a warning; returns what it printed."""
    process = [sys.executable, "-m", "pocketgs", *map(str, command)]
    result = subprocess.run(process, capture_output=True, text=True)
    assert (result.returncode, result.stderr) == (0, "")
    return result.stdout


def check(record: dict[str, Any], psnr: float, ssim: float) -> None:
    """Quality of at least so much, within the bounds on size and memory."""
    size, memory = record["gaussians"], record["peak_rss_mb"]
    print(f"{record['psnr']:.2f} dB, SSIM {record['ssim']:.4f}, {size} Gaussians, {memory:.0f} MB")
    assert record["psnr"] >= psnr
    assert record["ssim"] >= ssim
    assert size <= record["options"]["max_gaussians"] <= 50_000
    assert memory < 1000
