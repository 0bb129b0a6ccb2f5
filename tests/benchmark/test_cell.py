"""A cell runs in a process of its own, is measured there, and fails alone."""

from __future__ import annotations

import json
import os
import re
import signal
import sys
import threading
from pathlib import Path

import psutil
import pytest

from benchmark.toy_jobs import ON_POSIX, QUICK, job, wait_for
from pocketgs.benchmark import cell
from pocketgs.benchmark.aggregate import STAGES
from pocketgs.benchmark.captures import BenchCapture
from pocketgs.benchmark.cell import Job, run_cell
from pocketgs.benchmark.conditions import present_conditions
from pocketgs.benchmark.methods import METHODS
from pocketgs.benchmark.results import CellResult
from pocketgs.benchmark.sources import PACKAGE


@pytest.fixture(scope="module")
def measured(written_capture: Path, tmp_path_factory: pytest.TempPathFactory) -> CellResult:
    """A cell that has been run."""
    return run_cell(job(written_capture), tmp_path_factory.mktemp("work"))


def test_a_cell_measures_the_command(measured: CellResult) -> None:
    assert measured.error is None
    assert measured.command == f"pocketgs train toys {' '.join(QUICK)} --seed 0"
    assert measured.run["iterations"] == 12
    assert 10 < measured.run["psnr"] < 60
    assert [sample["iteration"] for sample in measured.run["progress"]] == [4, 8, 12]
    elapsed = [sample["elapsed"] for sample in measured.run["progress"]]
    assert elapsed == sorted(elapsed)
    assert 0 < elapsed[-1] < measured.wall_seconds <= measured.run["seconds"]["total"]
    assert measured.scene_bytes["spz"] < measured.scene_bytes["ply"]
    assert "decisions" not in measured.run["prior"]
    assert measured.machine["processor"]
    assert measured.conditions == present_conditions(QUICK)


def test_every_stage_of_a_run_has_its_place_in_the_report(measured: CellResult) -> None:
    listed = {name for names in STAGES.values() for name in names}
    assert set(measured.run["seconds"]) - {"total"} <= listed
    sources = (path.read_text(encoding="utf-8") for path in PACKAGE.rglob("*.py"))
    named = {name for source in sources for name in re.findall(r'stopwatch\.stage\("([^"]*)"\)', source)}
    assert {"planning", "points", "training"} <= named
    assert named <= listed


def test_a_cell_keeps_how_memory_went(measured: CellResult) -> None:
    samples = measured.run["memory"]
    assert len(samples) >= 3
    assert {sample["stage"] for sample in samples} <= set(measured.run["seconds"])
    assert max(sample["rss_mb"] for sample in samples) <= measured.run["peak_rss_mb"] + 1
    assert [sample["seconds"] for sample in samples] == sorted(sample["seconds"] for sample in samples)


def test_a_result_does_not_say_where_its_capture_lies(capture_folder: Path, tmp_path: Path) -> None:
    (capture_folder / "images" / "0003.png").unlink()
    result = run_cell(job(capture_folder), tmp_path / "work")
    assert result.error is None
    assert any(warning.startswith("toys/transforms.json: ") for warning in result.run["capture"]["warnings"])
    assert str(capture_folder) not in json.dumps(result.run)


def test_a_capture_named_by_a_dot(
    measured: CellResult, written_capture: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(written_capture)
    here = Job(METHODS["pocketgs"], BenchCapture("here", Path(".")), 0, QUICK)
    result = run_cell(here, tmp_path)
    assert (result.error, result.run["psnr"]) == (None, measured.run["psnr"])


def test_a_cell_run_again_gives_the_same_figures(measured: CellResult, written_capture: Path, tmp_path: Path) -> None:
    again = run_cell(job(written_capture), tmp_path)
    assert (again.run["psnr"], again.run["ssim"]) == (measured.run["psnr"], measured.run["ssim"])


def python_cell(written_capture: Path, work: Path, monkeypatch: pytest.MonkeyPatch, program: str) -> CellResult:
    """Run a cell whose command is a program in Python."""
    (work / "program.py").write_text(program)
    (work / "python").write_text(f'#!/bin/sh\nexec "{sys.executable}" "{work / "program.py"}"\n')
    (work / "python").chmod(0o755)
    monkeypatch.setattr(cell.sys, "executable", str(work / "python"))
    return run_cell(job(written_capture), work)


@ON_POSIX
@pytest.mark.parametrize(("word", "error"), [("", " and no output"), ("far so good", ": far so good")])
def test_a_killed_cell_says_so(
    word: str, error: str, written_capture: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program = f"import os, signal; print({word!r}, flush=True); os.kill(os.getpid(), signal.SIGKILL)"
    result = python_cell(written_capture, tmp_path, monkeypatch, program)
    assert result.error == f"ended with status −9{error}"
    assert result.conditions == present_conditions(QUICK)


@ON_POSIX
@pytest.mark.parametrize("stubborn", [False, True])
def test_an_interrupted_cell_may_tidy_up_but_not_stay(
    stubborn: bool, written_capture: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program = f"""
import os, signal, time
signal.signal(signal.SIGTERM, signal.default_int_handler)
print(os.getpid(), "ready", flush=True)
while True:
    try:
        time.sleep(600)
    except KeyboardInterrupt:
        print("tidied", flush=True)
        if not {stubborn}:
            raise
"""
    log = tmp_path / f"{job(written_capture).cell.name}.log"

    def interrupt() -> None:
        wait_for("ready", log)
        os.kill(os.getpid(), signal.SIGINT)

    monkeypatch.setattr(cell, "GRACE", 1.0 if stubborn else 60.0)
    thread = threading.Thread(target=interrupt)
    thread.start()
    with pytest.raises(KeyboardInterrupt):
        python_cell(written_capture, tmp_path, monkeypatch, program)
    thread.join()
    said = log.read_text()
    assert "tidied" in said
    assert not psutil.pid_exists(int(said.split()[0]))


def test_a_capture_that_cannot_be_read_fails_its_cell_in_one_line(capture_folder: Path, tmp_path: Path) -> None:
    (capture_folder / "transforms.json").write_text("{")
    result = run_cell(job(capture_folder), tmp_path)
    assert result.error is not None
    assert "transforms.json" in result.error
    assert "\n" not in result.error
    assert result.run == {}


def test_a_cell_without_held_out_views_fails(written_capture: Path, tmp_path: Path) -> None:
    result = run_cell(job(written_capture, flags=(*QUICK, "--hold-out", "0")), tmp_path)
    assert result.error == "the capture has no held-out view to measure on"


def test_only_the_captures_path_is_removed() -> None:
    record = json.dumps(["/data", "/data/images", "left/data_1.png", "left/data/1.png", "/data.old"])
    assert json.loads(cell._named_alone(record, Path("/data"))) == ["data", "data/images", *json.loads(record)[2:]]
