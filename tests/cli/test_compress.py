"""`pocketgs compress` and `pocketgs train --compress`."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from pocketgs.compression import candidates
from pocketgs.scene.formats import read_scene


@pytest.fixture(autouse=True)
def _few_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("TUNING_STEPS", "ROUNDING_STEPS", "PRUNING_STEPS", "STEPS"):
        monkeypatch.setattr(candidates, name, getattr(candidates, name) // 20)


def test_a_result_folder_and_its_capture(
    pocketgs: Callable[..., Any], result: Path, written_capture: Path, tmp_path: Path
) -> None:
    path, figures = tmp_path / "small.pgs", tmp_path / "figures.json"
    outcome = pocketgs("compress", result, written_capture, "--output", path, "--size", 0.01, "--json", figures)
    assert (outcome.status, outcome.errors) == (0, "")
    assert 0 < path.stat().st_size <= 10_000
    assert f"{len(read_scene(path)):,} Gaussians in {path}, {path.stat().st_size:,} bytes" in outcome.output
    rows = json.loads(figures.read_text())["figures"]
    assert [row["name"] for row in rows[:2]] == ["original", ".spz"]
    assert [row["megabytes"] for row in rows if row["name"] == ".pgs, written"] == [path.stat().st_size / 1e6]
    assert all(row["psnr"] > 10 for row in rows)


def test_a_scene_alone(pocketgs: Callable[..., Any], result: Path, tmp_path: Path) -> None:
    path = tmp_path / "small.pgs"
    outcome = pocketgs("compress", result / "scene.ply", "--output", path, "--time-budget", 5)
    assert outcome.status == 0, outcome.errors
    assert "renderings of the original" in outcome.output
    assert len(read_scene(path)) > 0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--output", "out.ply"], "not the name of a compressed scene, expected one that ends in .pgs"),
        (["--output", "nowhere/out.pgs"], "its folder does not exist"),
        (["--output", "out.pgs", "--size", "1", "--quality", "1"], "both --size and --quality"),
        (["--output", "out.pgs", "--size", "0"], "size: found 0.0, expected megabytes above 0"),
        (["--output", "out.pgs", "--quality", "nan"], "quality: found nan, expected dB, at least 0"),
        (["missing", "--output", "out.pgs"], "missing"),
    ],
)
def test_mistakes_leave_files_alone(
    pocketgs: Callable[..., Any],
    result: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    arguments: list[str],
    message: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("out.pgs").write_bytes(b"before")
    outcome = pocketgs("compress", result, *arguments)
    assert outcome.status == 2
    assert message in outcome.errors
    assert Path("out.pgs").read_bytes() == b"before"


def test_what_is_no_scene(pocketgs: Callable[..., Any], written_capture: Path, tmp_path: Path) -> None:
    outcome = pocketgs("compress", written_capture, "--output", tmp_path / "out.pgs")
    assert outcome.status == 2
    assert "no scene, expected a scene file or a result folder, then the capture" in outcome.errors


def test_another_size_of_photographs_is_noticed(
    pocketgs: Callable[..., Any], result: Path, written_capture: Path, tmp_path: Path
) -> None:
    options = ["--downscale", 2, "--size", 0.02, "--time-budget", 1]
    outcome = pocketgs("compress", result, written_capture, "--output", tmp_path / "out.pgs", *options)
    assert outcome.status == 0, outcome.errors
    assert "the scene was trained on photographs 96 pixels wide, found 48" in outcome.output


def test_training_and_compressing(pocketgs: Callable[..., Any], written_capture: Path, tmp_path: Path) -> None:
    folder = tmp_path / "result"
    options = ["--output", folder, "--prior", "none", "--iterations", 20, "--evaluate-every", 0]
    assert pocketgs("train", written_capture, *options, "--compress").status == 0
    assert (folder / "scene.pgs").stat().st_size < (folder / "scene.ply").stat().st_size / 4
    # The next run's scene is another one.
    assert pocketgs("train", written_capture, *options).status == 0
    assert not (folder / "scene.pgs").exists()
    (folder / "scene.pgs").write_bytes(b"somebody else's")
    outcome = pocketgs("train", written_capture, *options, "--compress")
    assert outcome.status == 2
    assert "scene.pgs" in outcome.errors
