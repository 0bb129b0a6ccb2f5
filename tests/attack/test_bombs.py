"""Files that state far more than they hold are refused before anything is allocated for it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from attack import bombs

READ_ALL = """
import sys, time
from pathlib import Path
from pocketgs import PocketGSError
from pocketgs.capture import open_capture
from pocketgs.scene.formats import is_scene_name, read_scene
from pocketgs.files.memory_bound import memory_bound
from pocketgs.system.process import peak_rss_mb

before = peak_rss_mb()
with memory_bound(300):
    for path in map(Path, sys.argv[1:]):
        started = time.perf_counter()
        try:
            (read_scene if is_scene_name(path) else open_capture)(path)
            print(path.name, "was read")
        except PocketGSError as error:
            told = "refused" if "MB of memory, expected at most 300 MB" in str(error) else str(error)
            print(path.name, told)
        if time.perf_counter() - started > 30:
            print(path.name, "took", time.perf_counter() - started, "s")
print("peak", peak_rss_mb() - before)
"""


def test_bombs(tmp_path: Path) -> None:
    alone, many = tmp_path / "alone", tmp_path / "many"
    for folder in (alone, many):
        folder.mkdir()
    huge = bombs.png(alone / "0.png", 13_350, 13_350)
    (alone / "1.png").hardlink_to(huge)
    first = bombs.png(many / "0.png", 2000, 2000)
    others = [many / f"{index}.png" for index in range(1, 40)]
    for other in others:
        other.hardlink_to(first)
    files = [
        bombs.spz_gzip(tmp_path / "gzip.spz", 2_000_000),
        bombs.spz_zstd(tmp_path / "zstd.spz", 20_000_000),
        bombs.gltf_shared_view(tmp_path / "shared.gltf", 4000, 400),
        bombs.gltf_shared_view(tmp_path / "few.gltf", 400_000, 4),
        bombs.gltf_named_often(tmp_path / "often.gltf", 4_000_000, 400),
        bombs.gltf_many_nodes(tmp_path / "nodes.gltf", 100_000),
        bombs.r3d_metadata(tmp_path / "metadata.r3d", 500_000_000),
        bombs.capture_of(alone, [huge, alone / "1.png"], 13_350, 13_350),
        bombs.capture_of(many, [first, *others], 2000, 2000),
    ]
    command = [sys.executable, "-c", READ_ALL, *map(str, files)]
    run = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert run.stderr == "", "no warning reaches a user"
    *told, peak = run.stdout.splitlines()
    assert float(peak.split()[1]) < 300
    found = dict(line.split(" ", 1) for line in told)
    # A file that many buffers name is there once, so nothing is wrong with it but what it shows.
    assert "MB of memory" not in found.pop("often.gltf")
    assert "more Gaussians than it has bytes" in found.pop("shared.gltf")
    assert "more than 4096 groups" in found.pop("nodes.gltf")
    assert set(found.values()) == {"refused"}, found


def test_a_scene_within_the_bound_is_read(tmp_path: Path) -> None:
    pocketgs = pytest.importorskip("pocketgs")
    assert len(pocketgs.Gaussians.load(bombs.spz_gzip(tmp_path / "small.spz", 1000))) == 1000
