"""Cells run in processes of their own, go on where they stopped, and fail alone."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest

from pocketgs.bench import session
from pocketgs.bench.captures import BenchCapture
from pocketgs.bench.cell import Job, run_cell
from pocketgs.bench.methods import METHODS
from pocketgs.bench.results import Cell, CellResult, read_results, write_result
from pocketgs.cli import main
from pocketgs.summary import versions

QUICK = ("--iterations", "12", "--evaluate-every", "4", "--engine", "cpu", "--max-gaussians", "1000")


def job(capture: Path, method: str = "pocketgs", seed: int = 0, flags: tuple[str, ...] = QUICK) -> Job:
    return Job(METHODS[method], BenchCapture(capture.name, capture), seed, flags)


def result_of(done: Job, seconds: float = 10.0, error: str | None = None) -> CellResult:
    return CellResult(done.cell, done.command, error, seconds, run={"versions": versions()})


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


def test_a_cell_keeps_how_memory_went(measured: CellResult) -> None:
    samples = measured.run["memory"]
    assert len(samples) >= 3
    assert {sample["stage"] for sample in samples} <= set(measured.run["seconds"])
    assert max(sample["rss_mb"] for sample in samples) <= measured.run["peak_rss_mb"] + 1
    assert [sample["seconds"] for sample in samples] == sorted(sample["seconds"] for sample in samples)


def test_a_cell_run_again_gives_the_same_figures(measured: CellResult, written_capture: Path, tmp_path: Path) -> None:
    again = run_cell(job(written_capture), tmp_path)
    assert (again.run["psnr"], again.run["ssim"]) == (measured.run["psnr"], measured.run["ssim"])


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


def test_what_has_a_result_is_not_run_again(tmp_path: Path) -> None:
    jobs = [job(tmp_path, method, seed) for seed in (0, 1) for method in ("pocketgs", "no-seeding")]
    first, second, third, fourth = jobs
    other_command = replace(result_of(second), command="pocketgs train elsewhere")
    failed = result_of(third, error="no memory")
    older = replace(result_of(fourth), run={"versions": {"pocketgs": "0.0.1"}})
    assert session.remaining(jobs, [result_of(first), other_command, failed, older]) == [second, third, fourth]


def test_time_left_comes_from_the_most_alike_results(tmp_path: Path) -> None:
    fast, slow = job(tmp_path, "3dgs-sfm"), job(tmp_path, "pocketgs")
    elsewhere = job(tmp_path / "elsewhere", "pocketgs")
    assert session.seconds_left([fast], []) is None
    assert session.seconds_left([fast], [result_of(elsewhere, 40.0)]) == session.OVERHEAD * 40
    done = [result_of(fast, 8.0), result_of(slow, 24.0), result_of(elsewhere, 100.0)]
    assert session.seconds_left([fast, fast, slow], done) == session.OVERHEAD * 40
    assert session.seconds_left([job(tmp_path, "no-dense")], done) == session.OVERHEAD * 16


def test_a_failed_cell_does_not_lose_the_others(
    written_capture: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def run(cell: Job, work: Path) -> CellResult:
        return result_of(cell, error="broken" if cell.seed == 1 else None)

    monkeypatch.setattr(session, "run_cell", run)
    told: list[Cell] = []
    jobs = [job(written_capture, seed=seed) for seed in range(3)]
    session.run_jobs(jobs, tmp_path, tmp_path, lambda step: told.append(step.cell), lambda result: None)
    assert told == [cell.cell for cell in jobs]
    assert [result.error for result in read_results(tmp_path)] == [None, "broken", None]


def test_the_first_seed_of_everything_comes_first(tmp_path: Path) -> None:
    captures = [BenchCapture(name, tmp_path / name) for name in ("fern", "fox")]
    jobs = session.plan_jobs([METHODS["pocketgs"], METHODS["3dgs-mvs"]], captures, (0, 1), ())
    assert [(entry.seed, entry.capture.name, entry.method.name) for entry in jobs] == [
        (seed, capture, method) for seed in (0, 1) for capture in ("fern", "fox") for method in ("pocketgs", "3dgs-mvs")
    ]


def bench_arguments(capture: Path, folder: Path, *more: str) -> list[str]:
    common = ["--iterations", "10", "--evaluate-every", "5", "--engine", "cpu"]
    return [
        "bench",
        "--captures",
        str(capture),
        *common,
        "--output",
        str(folder),
        "--work",
        str(folder / "work"),
        *more,
    ]


def test_the_command_writes_results_table_and_report_and_goes_on_where_it_stopped(
    written_capture: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    main(bench_arguments(written_capture, tmp_path, "--methods", "pocketgs", "no-seeding"))
    names = {path.name for path in tmp_path.iterdir()}
    assert names == {"toys.pocketgs.0.json", "toys.no-seeding.0.json", "results.md", "report.html", "work"}
    first, second = read_results(tmp_path)
    for result in (first, second):
        assert f"{result.run['psnr']:.2f}" in (tmp_path / "results.md").read_text()
        assert f"{result.run['psnr']:.2f}" in (tmp_path / "report.html").read_text()

    def refuse(cell: Job, work: Path) -> CellResult:
        raise AssertionError("nothing is left to run")

    monkeypatch.setattr(session, "run_cell", refuse)
    capsys.readouterr()
    main(bench_arguments(written_capture, tmp_path, "--methods", "pocketgs", "no-seeding"))
    assert "2 cells, 2 of them done before" in capsys.readouterr().out


def test_failed_cells_end_the_command_with_2_and_their_names(
    capture_folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (capture_folder / "transforms.json").write_text("{")
    with pytest.raises(SystemExit) as ended:
        main(bench_arguments(capture_folder, tmp_path, "--methods", "pocketgs"))
    assert ended.value.code == 2
    assert "1 of 1 cells failed: toys.pocketgs.0" in capsys.readouterr().err
    assert "transforms.json" in (tmp_path / "results.md").read_text()


@pytest.mark.skipif(sys.platform == "win32", reason="Ctrl-C is sent otherwise there")
def test_ctrl_c_ends_the_cell_and_keeps_the_others(written_capture: Path, tmp_path: Path) -> None:
    write_result(tmp_path, result_of(job(written_capture, seed=7)))
    shutil.copy(tmp_path / "toys.pocketgs.7.json", tmp_path / "before")
    arguments = bench_arguments(written_capture, tmp_path, "--methods", "pocketgs")
    arguments[arguments.index("--iterations") + 1] = "1000000"
    command = [sys.executable, "-m", "pocketgs", *arguments]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True) as process:
        log = tmp_path / "work" / "toys.pocketgs.0.log"
        deadline = time.monotonic() + 120
        while not (log.is_file() and "iteration" in log.read_text()) and time.monotonic() < deadline:
            time.sleep(0.1)
        os.killpg(process.pid, signal.SIGINT)
        _, errors = process.communicate(timeout=60)
    assert process.returncode == 130, errors.decode()
    assert (tmp_path / "toys.pocketgs.7.json").read_bytes() == (tmp_path / "before").read_bytes()
    assert not (tmp_path / "toys.pocketgs.0.json").exists()
