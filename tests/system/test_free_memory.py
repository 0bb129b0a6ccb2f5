"""Limits on memory that containers set."""

from __future__ import annotations

import math
from pathlib import Path

import psutil
import pytest

from pocketgs.system.free_memory import free_memory, memory_left

VERSION_2 = {"memory.max": "2000000\n", "memory.current": "700000\n", "memory.stat": "anon 5\ninactive_file 100000\n"}
VERSION_1 = {
    "memory/memory.limit_in_bytes": "2000000\n",
    "memory/memory.usage_in_bytes": "700000\n",
    "memory/memory.stat": "inactive_file 7\ntotal_inactive_file 100000\n",
}


@pytest.mark.parametrize(
    ("files", "expected"),
    [
        (VERSION_2, 1_400_000),
        (VERSION_1, 1_400_000),
        ({**VERSION_2, "memory.max": "max\n"}, math.inf),
        ({**VERSION_2, "memory.current": "3000000\n"}, 0),
        ({**VERSION_2, "memory.current": "what\n"}, math.inf),
        ({"memory.max": "2000000\n"}, math.inf),
        ({}, math.inf),
    ],
)
def test_what_control_groups_leave(tmp_path: Path, files: dict[str, str], expected: float) -> None:
    (tmp_path / "memory").mkdir()
    for name, content in files.items():
        (tmp_path / name).write_text(content)
    assert memory_left(tmp_path) == expected


def test_no_more_than_the_machine_has() -> None:
    assert 0 < free_memory() <= psutil.virtual_memory().total
