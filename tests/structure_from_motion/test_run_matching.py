"""Matching in processes side by side: what is found, and what happens if one of them fails."""

from __future__ import annotations

import os
import shutil
import sys
import time
from itertools import combinations
from pathlib import Path
from threading import Thread
from types import SimpleNamespace
from typing import Any

import numpy as np
import psutil
import pytest
from PIL import Image

from pocketgs.errors import PocketGSError
from pocketgs.structure_from_motion import run_matching
from pocketgs.structure_from_motion.colmap.match_file import read_match_file
from pocketgs.structure_from_motion.photographs import Photograph, read_photographs
from pocketgs.structure_from_motion.process import run_side_by_side

SHIFT = 8
"""Pixels between two photographs."""


@pytest.fixture
def photographs(tmp_path: Path) -> list[Photograph]:
    """Seven photographs that are taken from a moving window over a texture, and a blank one."""
    folder, workspace = tmp_path / "photographs", tmp_path / "workspace"
    folder.mkdir()
    workspace.mkdir()
    texture = np.asarray(Image.effect_noise((60, 60), 120).resize((480, 480), Image.Resampling.BICUBIC))
    for number in range(7):
        window = texture[:, number * SHIFT : number * SHIFT + 320]
        Image.fromarray(window).convert("RGB").save(folder / f"# {number} (1).png")
    Image.new("RGB", (320, 480), "grey").save(folder / "blank.png")
    return read_photographs(folder, tmp_path / "none", workspace, 480, 2, lambda done, of: None)


def found(files: list[str]) -> dict[tuple[str, str], np.ndarray]:
    """Matches by pair of names."""
    return {pair: rows for file in files for pair, rows in read_match_file(file).items()}


def test_any_number_of_processes_finds_the_same_matches(
    photographs: list[Photograph], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pairs = list(combinations(sorted(photograph.name for photograph in photographs), 2))
    monkeypatch.setattr(run_matching, "PAIRS_PER_PROCESS", 1)
    answers = []
    for processes in (1, 3):
        monkeypatch.setattr(run_matching, "usable_cores", lambda processes=processes: processes)
        counts: list[tuple[int, int]] = []
        files = run_matching.match(
            photographs, pairs, tmp_path / "workspace", lambda done, of, counts=counts: counts.append((done, of))
        )
        assert len(files) == processes
        assert counts == sorted(counts)
        assert counts[-1] == (len(pairs), len(pairs))
        answers.append(found(files))
    one, three = answers
    assert set(one) == {pair for pair in pairs if "blank.png" not in pair}
    assert one.keys() == three.keys()
    for pair, rows in one.items():
        np.testing.assert_array_equal(rows, three[pair])
    keypoints = {photograph.name: np.load(photograph.file)["keypoints"][:, :2] for photograph in photographs}
    for (first, second), rows in one.items():
        moved = keypoints[first][rows[:, 0]] - keypoints[second][rows[:, 1]]
        steps = int(second.split()[1]) - int(first.split()[1])
        right = np.abs(moved - [steps * SHIFT, 0]).max(axis=1) < 1
        assert right.sum() > 100
        assert right.mean() > 0.9


def test_photographs_that_share_nothing_have_no_matches(photographs: list[Photograph], tmp_path: Path) -> None:
    pairs = [(photographs[0].name, "blank.png")]
    assert found(run_matching.match(photographs, pairs, tmp_path / "workspace", lambda done, of: None)) == {}


def job(folder: Path, number: int, features: Path | str) -> dict[str, Any]:
    """A job of two photographs with the same features."""
    return {
        "database": str(folder / f"{number}.db"),
        "features": {"one.png": str(features), "other.png": str(features)},
        "pairs": [("one.png", "other.png")],
        "matches": str(folder / f"{number}.npz"),
    }


@pytest.fixture
def endless(tmp_path: Path) -> dict[str, Any]:
    """A job that waits for features until it is killed."""
    if sys.platform == "win32":
        pytest.skip("Windows has no named pipes in folders")
    os.mkfifo(tmp_path / "endless.npz")
    return job(tmp_path, 9, tmp_path / "endless.npz")


def test_a_process_that_fails_stops_the_others(tmp_path: Path, endless: dict[str, Any]) -> None:
    with pytest.raises(PocketGSError, match=r"^COLMAP failed \(FileNotFoundError: .+none\.npz'\)$"):
        run_side_by_side("matching", [endless, job(tmp_path, 0, "none.npz")], tmp_path, lambda done: None)
    assert matching_processes() == []


def test_ctrl_c_stops_all_processes(photographs: list[Photograph], tmp_path: Path, endless: dict[str, Any]) -> None:
    def stop(done: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_side_by_side("matching", [endless, job(tmp_path, 0, photographs[0].file)], tmp_path, stop)
    assert matching_processes() == []


def test_a_process_that_is_killed_is_an_error(tmp_path: Path, endless: dict[str, Any]) -> None:
    def kill() -> None:
        while not matching_processes():
            time.sleep(0.01)
        matching_processes()[0].kill()

    Thread(target=kill).start()
    with pytest.raises(PocketGSError, match=r"^COLMAP failed \(status -9\)$"):
        run_side_by_side("matching", [endless], tmp_path, lambda done: None)


def test_the_number_of_processes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """No more than cores, than are worth starting, and than fit half of the memory and of the disk."""
    gigabytes = {"memory": 100.0, "disk": 100.0}
    monkeypatch.setattr(run_matching, "usable_cores", lambda: 8)
    monkeypatch.setattr(run_matching, "free_memory", lambda: gigabytes["memory"] * 1e9)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=gigabytes["disk"] * 1e9))
    assert run_matching._processes(10_000, 100, tmp_path) == 8
    assert run_matching._processes(3 * run_matching.PAIRS_PER_PROCESS, 100, tmp_path) == 3
    assert run_matching._processes(1, 2, tmp_path) == 1
    for kind in gigabytes:
        monkeypatch.setitem(gigabytes, kind, 1)
        assert run_matching._processes(10_000, 40, tmp_path) == 2
        assert run_matching._processes(10_000, 1000, tmp_path) == 1
        monkeypatch.setitem(gigabytes, kind, 100)


def matching_processes() -> list[psutil.Process]:
    return [child for child in psutil.Process().children() if any(".matching" in word for word in child.cmdline())]
