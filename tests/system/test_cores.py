"""The number of threads if the process may use fewer cores than the machine has."""

from __future__ import annotations

import math
import os
import subprocess
import sys
from pathlib import Path

import pytest

from pocketgs.system.cores import time_quota


@pytest.mark.parametrize(
    ("text", "cores"), [("max 100000\n", math.inf), ("150000 100000\n", 1.5), ("", math.inf), ("0 0", math.inf)]
)
def test_a_quota_of_time_is_read(tmp_path: Path, text: str, cores: float) -> None:
    (tmp_path / "cpu.max").write_text(text)
    assert time_quota(tmp_path) == cores


@pytest.mark.parametrize(("quota", "cores"), [("-1\n", math.inf), ("200000\n", 2.0)])
def test_so_is_that_of_the_first_version(tmp_path: Path, quota: str, cores: float) -> None:
    (tmp_path / "cpu").mkdir()
    (tmp_path / "cpu" / "cpu.cfs_quota_us").write_text(quota)
    (tmp_path / "cpu" / "cpu.cfs_period_us").write_text("100000\n")
    assert time_quota(tmp_path) == cores


def test_where_there_is_none_all_cores_may_be_used(tmp_path: Path) -> None:
    assert time_quota(tmp_path) == math.inf


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="this system does not bind processes to cores")
def test_a_process_that_is_bound_to_one_core_has_one_thread() -> None:
    bound = "import os; os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})"
    code = f"{bound}; from pocketgs.system.cores import kernel_threads; print(kernel_threads(None), kernel_threads(8))"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert result.stdout.split() == ["1", "1"]
